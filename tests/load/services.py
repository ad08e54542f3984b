"""The processes of a service that are killed, each started again at once, as by a service manager."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from tests.support.jobs import RedisServer
from tests.support.servers import find_workers

if TYPE_CHECKING:
    import random
    from pathlib import Path

STOP_SECONDS = 60.0
MOST_DOWN_SECONDS = 0.5
"""Of Redis; the other processes take longer to start."""
TARGETS = {"sqlite": ("web", "worker process"), "redis": ("web", "worker", "worker process", "redis")}
"""What can be killed, by queue."""


class Process:
    """`ciir COMMAND`, which is started again whenever it ends."""

    def __init__(self, log: Path, environment: dict[str, str], *command: str) -> None:
        self._log, self._environment = log, os.environ | environment
        self._command = [sys.executable, "-m", "ciir", *command]
        self.failures: list[int] = []
        """Exit statuses other than 0 where it was not killed."""
        self._start()

    def _start(self) -> None:
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(self._command, stdout=log, stderr=log, env=self._environment)  # noqa: S603
        self.pid = self._process.pid

    def kill(self) -> None:
        """Kills it and starts it again."""
        self._process.kill()
        self._process.wait()
        self._start()

    def restart_if_ended(self) -> None:
        """Starts it again if it has ended by itself."""
        if (status := self._process.poll()) is not None:
            self.failures.append(status)
            self._start()

    def stop(self) -> None:
        """Ends it with SIGTERM."""
        self._process.terminate()
        try:
            status = self._process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            status = self._process.wait()
        if status not in {0, -signal.SIGTERM}:  # the latter if it has only just been started
            self.failures.append(status)


class Services:
    """The processes of a service. A context, in which they run."""

    def __init__(self, queue: str, folder: Path, port: int) -> None:
        environment = {"CIIR_FOLDER": str(folder / "service")}
        self.redis = RedisServer() if queue == "redis" else None
        serve = ("serve", "--port", str(port))
        if self.redis is None:
            self.processes = {"web": Process(folder / "web.log", environment, *serve)}
            return
        self.redis.start()
        environment["CIIR_QUEUE"] = self.redis.url
        self.processes = {
            "web": Process(folder / "web.log", environment | {"CIIR_WORKERS": "0"}, *serve),
            "worker": Process(folder / "worker.log", environment, "worker"),
        }

    def kill(self, target: str, chance: random.Random) -> bool:
        """Kills one; False if there is none at the moment."""
        if target == "redis" and self.redis is not None:
            self.redis.kill()
            time.sleep(chance.uniform(0, MOST_DOWN_SECONDS))
            self.redis.start()
        elif target == "worker process":
            with suppress(FileNotFoundError, ProcessLookupError):  # one of them ended just now
                if workers := find_workers([*self.processes.values()][-1].pid):
                    os.kill(chance.choice(workers), signal.SIGKILL)
                    return True
            return False
        else:
            self.processes[target].kill()
        return True

    def close(self) -> None:
        """Ends all."""
        for process in self.processes.values():
            process.stop()
        if self.redis is not None:
            self.redis.close()
