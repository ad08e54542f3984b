"""A worker process, seen from its parent."""

from __future__ import annotations

import json
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ciir.model_folder import MODEL_FOLDER, find_model_folder
from ciir.service.jobs.workers.messages import LIMIT, make_printable, parse_message

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.service.jobs.workers.messages import Message
    from ciir.service.jobs.workers.task import TaskLimits

MODULE = "ciir.service.jobs.workers.process"
"""The module that the process runs."""
SEND_SECONDS = 10.0
"""A worker that does not read a task within this time is broken."""
EXIT_SECONDS = 1.0
"""Time for a process that has closed its socket to end by itself, so that its own exit status is available."""
LOG_LINES, LINE_BYTES = 200, 1000
"""Most lines that a worker process can write to the log, and most bytes of each."""
_CHUNK = 1 << 16
KEPT_VARIABLES = (
    "CUDA_", "DRI_", "EGL_", "GALLIUM_", "HOME", "LANG", "LC_", "LD_LIBRARY_PATH", "LIBGL_", "LP_",
    "MALLOC_", "MESA_", "NVIDIA_", "OMP_", "OPENBLAS_", "PATH", "PYOPENGL_", "PYTHON", "TZ", "XDG_CACHE_HOME", "__EGL_",
)  # fmt: skip
"""Prefixes of the environment variables that a worker process gets. No other variable is passed to it."""
_log = logging.getLogger("ciir.pool")


class WorkerExitedError(Exception):
    """The process has ended, or it was ended because it broke the protocol."""

    def __init__(self, exitcode: int, reason: str) -> None:
        super().__init__(reason)
        self.exitcode = exitcode
        """Negative for a signal, whose number is the absolute value."""


class Worker:
    """A process that runs `MODULE`. Methods can be called from any thread."""

    def __init__(self, limits: TaskLimits) -> None:
        self._data, self._output = b"", b""
        self._lock, self._log_lock = threading.Lock(), threading.Lock()
        self._lines, self._unlogged = 0, list[str]()
        self.last_line = ""
        """The last line of its output."""
        self.tasks = 0
        """Number of tasks that it has run."""
        arguments = json.dumps({"parent": os.getpid(), "limits": asdict(limits)})
        self._socket, theirs = socket.socketpair()
        try:
            self._process = subprocess.Popen(  # noqa: S603 - our own program
                [sys.executable, "-P", "-m", MODULE, arguments],
                stdin=theirs.fileno(),
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                cwd="/",
                env=make_environment(),
                start_new_session=True,
            )
        except OSError:
            self._socket.close()
            raise
        finally:
            theirs.close()
        self.pid = self._process.pid
        assert self._process.stdout is not None  # noqa: S101 - a pipe was asked for
        self._log_file = self._process.stdout
        os.set_blocking(self._log_file.fileno(), False)

    def send(self, message: dict[str, Any], files: Sequence[int]) -> None:
        """Sends a task with open files. Raises `WorkerExitedError`."""
        data = json.dumps(message).encode() + b"\n"
        try:
            with self._lock:
                self._socket.settimeout(SEND_SECONDS)
                sent = socket.send_fds(self._socket, [data], files)
                self._socket.sendall(data[sent:])
        except OSError as error:
            raise self._describe_end("it accepts no task") from error

    def receive(self, seconds: float) -> Message | None:
        """Returns the next message, or None if it is not complete after `seconds`. Raises `WorkerExitedError`."""
        if b"\n" not in self._data and len(self._data) <= LIMIT:
            try:
                with self._lock:
                    self._socket.settimeout(seconds)
                    part = self._socket.recv(_CHUNK)
            except TimeoutError:
                return None
            except OSError:  # `end` closed it, or the worker died with data unread
                part = b""
            if not part:
                raise self._describe_end("it has ended")
            self._data += part
        line, newline, rest = self._data.partition(b"\n")
        if not newline and len(line) <= LIMIT:
            return None
        self._data = rest
        try:
            return parse_message(line)
        except ValueError as error:
            _log.error("worker process %d sent an invalid message and is replaced", self.pid)
            self.end()
            raise self._describe_end("it sent an invalid message") from error

    def read_cpu_seconds(self) -> float:
        """Reads the processor time of all its threads; 0 if it has ended, and on systems without /proc."""
        try:
            stat = Path(f"/proc/{self.pid}/stat").read_text()
        except (FileNotFoundError, ProcessLookupError):
            return 0.0
        fields = stat.rpartition(")")[2].split()  # proc(5): the part in brackets can contain spaces
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def is_alive(self) -> bool:
        """Checks whether the process is running."""
        return self._process.poll() is None

    def end(self) -> None:
        """Kills the process, if it is alive, and waits until it is dead."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        with self._lock:
            self._socket.close()
        self.read_output()
        with self._log_lock:
            self._log_file.close()

    def log_output(self) -> None:
        """Logs the output of the process since the last call."""
        self.read_output()
        with self._log_lock:
            lines, self._unlogged = self._unlogged, []
        for line in lines:
            _log.warning("worker process %d: %s", self.pid, line)

    def read_output(self) -> None:
        """Reads the output of the process and keeps it for `log_output`.

        The process blocks if nobody reads its output.
        """
        with self._log_lock:
            if self._log_file.closed:
                return
            try:
                part = os.read(self._log_file.fileno(), _CHUNK)
            except BlockingIOError:
                return
            *lines, self._output = (self._output + (part or b"\n")).split(b"\n")
            self._output = self._output[:LINE_BYTES]
            for line in filter(None, lines):
                self._keep_line(line[:LINE_BYTES].decode(errors="replace"))

    def _keep_line(self, line: str) -> None:
        self._lines += 1
        if self._lines <= LOG_LINES:
            self.last_line = make_printable(line)
            self._unlogged.append(self.last_line)
        if self._lines == LOG_LINES:
            self._unlogged.append("its further lines are left out")

    def _describe_end(self, reason: str) -> WorkerExitedError:
        """Returns the exception for a process that has closed the socket, which happens when it dies."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(EXIT_SECONDS)
        self.end()
        code = self._process.returncode
        return WorkerExitedError(code, f"{reason} ({describe_exit(code)})")


def make_environment() -> dict[str, str]:
    """Makes the environment of a worker process."""
    kept = {name: value for name, value in os.environ.items() if name.startswith(KEPT_VARIABLES)}
    paths = os.pathsep.join(os.path.abspath(path) for path in sys.path)  # noqa: PTH100 - "" is the current folder
    # Workers share the cores: OpenBLAS with a thread for each core would wait more than it works.
    defaults = {"OPENBLAS_NUM_THREADS": "1"}
    if (own := find_model_folder()) is not None:
        kept[MODEL_FOLDER] = str(own)
    return defaults | kept | {"PYTHONPATH": paths, "MESA_SHADER_CACHE_DISABLE": "true"}  # it must not write files


def describe_exit(exitcode: int) -> str:
    """Describes an exit status: `was ended by signal 9 (Killed)` or `ended with status 1`."""
    if exitcode >= 0:
        return f"ended with status {exitcode}"
    return f"was ended by signal {-exitcode} ({signal.strsignal(-exitcode)})"
