"""A Dask cluster of processes on this machine, which are restarted when they end, as containers are."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

import psutil
from distributed import Client

from ciir.service.batch.engines import SETTINGS, name_variable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

POLL_SECONDS = 0.2
MEMORY = "3GiB"


class Cluster:
    """A scheduler, and workers of one thread each under their nannies."""

    def __init__(self, workers: int, folder: str) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        quiet = ["--no-dashboard"]
        nanny = ["--nthreads", "1", "--memory-limit", MEMORY, "--local-directory", folder]
        scheduler = ["scheduler", "--host", "127.0.0.1", "--port", str(port)]
        self._commands = [[*scheduler, *quiet], *[["worker", self.address, *nanny, *quiet]] * workers]
        self._environment = os.environ | {name_variable(name): str(value) for name, value in SETTINGS.items()}
        self._ending = threading.Event()
        self._processes = [self._start(command) for command in self._commands]
        self._keeper = threading.Thread(target=self._keep, daemon=True)
        self._keeper.start()

    def _start(self, command: Sequence[str]) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *command], env=self._environment, stderr=subprocess.DEVNULL
        )

    def _keep(self) -> None:
        while not self._ending.wait(POLL_SECONDS):
            for number, process in enumerate(self._processes):
                if process.poll() is not None:
                    self._processes[number] = self._start(self._commands[number])

    def kill_worker(self, number: int) -> bool:
        """Kills the worker process under nanny `number`, with its work; returns False if it isn't running again yet."""
        try:
            helpers = psutil.Process(self._processes[1 + number].pid).children()
            found = [child for helper in helpers for child in helper.children()]  # of the fork server
        except psutil.NoSuchProcess:
            return False
        for child in found:
            child.kill()
        return bool(found)

    def kill_scheduler(self) -> None:
        """Kills the scheduler, which loses all its state; it is restarted at the same address."""
        self._processes[0].kill()

    def wait(self, workers: int) -> None:
        """Waits until that many workers are connected."""
        with Client(self.address, timeout=120, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=120)

    def close(self) -> None:
        """Ends all processes."""
        self._ending.set()
        self._keeper.join()
        for process in reversed(self._processes):
            process.send_signal(signal.SIGTERM)
        for process in self._processes:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


@contextmanager
def open_cluster(workers: int) -> Iterator[Cluster]:
    """Opens a cluster, and yields it when it is ready."""
    with tempfile.TemporaryDirectory(prefix="ciir-cluster-") as folder:
        cluster = Cluster(workers, folder)
        try:
            cluster.wait(workers)
            yield cluster
        finally:
            cluster.close()
            time.sleep(POLL_SECONDS)
