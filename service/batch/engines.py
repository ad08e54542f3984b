"""Dask as the engine: processes on this machine, or the scheduler and the workers of a cluster."""

from __future__ import annotations

import logging
import signal
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING

import dask
from distributed import Client, LocalCluster, get_worker
from distributed.comm.addressing import get_address_host_port

from ciir import cores
from ciir.errors import InvalidOption
from ciir.service.batch.work import work

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.service.batch.task import Outcome, Request, Task

ATTEMPTS = 10
"""How many workers may die during a task before it is postponed, and the second time before it counts as failed."""
CONNECT_SECONDS = 30.0
RECONNECT_SECONDS = 600.0
"""How long to wait for a scheduler after the connection to it was lost."""
SETTINGS = {
    "distributed.scheduler.allowed-failures": ATTEMPTS - 1,
    "distributed.scheduler.worker-saturation": 1.0,  # a worker holds only what it runs: no other task dies with it
    "distributed.worker.memory.target": False,  # results are small: there is nothing to spill
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # only the task uses memory; over the limit the worker is replaced
    "distributed.worker.memory.terminate": 0.95,
    # A fork replaces a dead worker in a fraction of the time, but only on Linux do all libraries support that.
    "distributed.worker.multiprocessing-method": "forkserver" if sys.platform == "linux" else "spawn",
}
"""Dask's settings on this machine; docs/batch.md has those for clusters."""


def name_variable(setting: str) -> str:
    """Returns the environment variable for a setting of Dask."""
    return f"DASK_{setting.replace('.', '__').replace('-', '_').upper()}"


def run_on_worker(task: Task, request: Request) -> Outcome:
    """Runs the task. Networks use as many threads as the worker has, because its processes share the machine."""
    cores.most_cores = get_worker().state.nthreads
    return work(task, request)


@contextmanager
def open_local(workers: int, memory: int | None) -> Iterator[Client]:
    """Opens a client with `workers` processes of one thread each on this machine, which end with the block.

    `memory`: bytes that a process may use before it is replaced, or None for an equal share of the machine's.
    """
    _silence_logs()
    starting = ExitStack()
    starting.enter_context(_hold_interrupts())
    with (
        starting,
        dask.config.set(SETTINGS),
        tempfile.TemporaryDirectory(prefix="ciir-batch-") as folder,
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=memory or "auto",
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            local_directory=folder,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        starting.close()
        yield client


@contextmanager
def _hold_interrupts() -> Iterator[None]:
    """Raises `KeyboardInterrupt` at the end of the block if Ctrl-C was pressed in it.

    Threads and processes started in the block have the signal blocked for good, because Ctrl-C reaches all processes of
    a terminal.
    """
    resource_tracker.ensure_running()  # multiprocessing would start it with the first process and unblock the signal
    came: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))  # earlier threads may still get it
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)


def connect(address: str, seconds: float = CONNECT_SECONDS) -> Client:
    """Connects to the scheduler at `address`. Raises `InvalidOption` if none answers within the time."""
    _silence_logs()
    end = time.monotonic() + seconds
    while True:
        try:
            get_address_host_port(address)  # a client that raises this itself takes a minute to end
            client = Client(address, timeout=min(seconds, CONNECT_SECONDS), set_as_default=False)
        except (OSError, ValueError) as error:
            if isinstance(error, ValueError) or time.monotonic() > end:
                raise InvalidOption(
                    f"--cluster: no scheduler answers at {address} ({error}); give the address that `dask scheduler` "
                    "prints, such as tcp://10.0.0.1:8786"
                ) from error
            time.sleep(1)
        else:
            return client


def _silence_logs() -> None:
    """Silences Dask, which logs each worker that ends, and each connection, with a traceback."""
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
