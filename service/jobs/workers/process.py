"""The main program of a worker process: enters the sandbox, loads the models, then runs one task after another.

`service.jobs.workers.worker` starts it. Standard input is a socket to the parent, with JSON lines in both directions;
each task comes with the open files of its input and its result. Standard output and error go to the parent's log.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import traceback
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ciir.cores import read_quota
from ciir.model_folder import find_model_folder
from ciir.service.jobs.workers.sandbox import restrictions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.service.jobs.workers.task import TaskLimits

_CHUNK = 1 << 16


class Channel:
    """The worker's end of the socket."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)

    def send(self, kind: str, **fields: Any) -> None:
        """Sends one message."""
        self._socket.sendall(json.dumps({"kind": kind, **fields}, allow_nan=False).encode() + b"\n")

    def receive(self) -> Iterator[tuple[Any, list[int]]]:
        """Yields messages and the open files that came with each, until the parent closes the socket."""
        data, files = b"", list[int]()
        while True:
            part, new, _, _ = socket.recv_fds(self._socket, _CHUNK, 2)
            if not part:
                return
            data, files = data + part, files + new
            if data.endswith(b"\n"):  # the parent sends the next one after the answer to this one
                yield json.loads(data), files
                data, files = b"", []


def main(parent: int, limits: dict[str, Any]) -> None:
    """Runs tasks until the process `parent` closes the socket."""
    channel = Channel(os.dup(0))
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    read_quota()  # the sandbox hides it
    own = find_model_folder()
    restrictions.enter(limits["memory"], limits["file"], parent, [] if own is None else [str(own)])

    from ciir.service.jobs.workers.task import TaskLimits, warm_up

    warm_up()
    channel.send("ready", missing=restrictions.missing)
    allowed = TaskLimits.from_json(limits)
    for message, files in channel.receive():
        channel.send("started")
        _run_task(channel, message, files, allowed)


def _run_task(channel: Channel, message: Any, files: list[int], limits: TaskLimits) -> None:
    from ciir.service.jobs.job import Request
    from ciir.service.jobs.workers.task import run_task

    source, target = open(files[0], "rb"), open(files[1], "w+b")  # noqa: PTH123, SIM115 - they are open already
    try:
        finished = run_task(Request(**message), source, target, limits, lambda data: channel.send("progress", **data))
        channel.send("done", **asdict(finished))
    except Exception:  # noqa: BLE001 - the parent logs it
        channel.send("failed", traceback=traceback.format_exc())
    finally:
        source.close()
        with suppress(OSError):  # a complete result was flushed before, and an error in that was sent
            target.close()


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
