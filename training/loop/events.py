"""TensorBoard's event file, written directly: the thread of its own writer cannot report a full disk."""

from __future__ import annotations

import io
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


class Events:
    """A new event file in `folder`: TensorBoard joins it to older files there, and hides their events after `step`.

    The format is TensorFlow's: `Event` messages as records of length, checksum, data and checksum
    (tensorboard/compat/proto/event.proto, tensorflow/core/lib/io/record_writer.h).

    Raises `ModuleNotFoundError` where the package tensorboard is not installed, `OSError` where the disk is full.
    """

    def __init__(self, folder: Path, *, step: int) -> None:
        from tensorboard.compat.proto import event_pb2  # type: ignore[import-untyped]

        now = time.time()
        self._path = folder / f"events.out.tfevents.{now:.6f}"  # in the order of names
        folder.mkdir(exist_ok=True)
        start = event_pb2.SessionLog(status=event_pb2.SessionLog.START)
        self._append(
            event_pb2.Event(wall_time=now, file_version="brain.Event:2"),
            event_pb2.Event(wall_time=now, step=step + 1, session_log=start),
        )

    def add(self, step: int, scalars: Mapping[str, float]) -> None:
        """Appends the values of `scalars` after `step`."""
        from tensorboard.compat.proto import event_pb2, summary_pb2

        values = [summary_pb2.Summary.Value(tag=tag, simple_value=value) for tag, value in scalars.items()]
        summary = summary_pb2.Summary(value=values)
        self._append(event_pb2.Event(wall_time=time.time(), step=step, summary=summary))

    def _append(self, *events: Any) -> None:
        from tensorboard.summary.writer.record_writer import RecordWriter  # type: ignore[import-untyped]

        records = io.BytesIO()
        for event in events:
            RecordWriter(records).write(event.SerializeToString())
        try:
            with self._path.open("ab") as file:
                file.write(records.getvalue())
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error
