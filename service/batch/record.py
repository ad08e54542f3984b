"""The record of an output: what it was made from, in a file next to the outputs."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

from ciir.errors import Unreadable
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.writer import REPORT
from ciir.service.batch.places import STATE
from ciir.service.batch.task import Outcome
from ciir.service.batch.trace import Trace, compute_key, matches

if TYPE_CHECKING:
    from ciir.service.batch.places import Outputs
    from ciir.service.batch.task import Request, Task
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source


class Record:
    """The record of a task's output, if there is one."""

    def __init__(self, outputs: Outputs, task: Task, request: Request) -> None:
        self._outputs, self._out, self._run = outputs, task.out, request.run
        self._name = f"{STATE}/records/{hash_name(task.out)}.json"
        part = task.part and (task.part.views, task.part.model, task.part.first, len(task.part.times))
        name = task.source.rpartition("/")[2]
        frames = request.white is not None, request.dark is not None  # what is in them is part of the trace
        self._key = compute_key(name, task.out, task.is_file, task.is_video, part, frames, options=request.options)
        self._kept: dict[str, Any] = self._read(task)

    def _read(self, task: Task) -> dict[str, Any]:
        """Reads the record; empty if there is none.

        If it is damaged, the output is made again, and the record only holds the files that the output's own report
        lists.
        """
        data = self._outputs.read(self._name)
        if data is None:
            return {}
        kept = _parse(data)
        if kept.keys() >= {"key", "run", "files", "trace", "report"}:
            return kept
        if task.is_file:
            return {"files": [task.out]}
        report = f"{task.out}/{REPORT}"
        try:
            names = [str(view["file"]) for view in _parse(self._outputs.read(report))["views"]]
        except (LookupError, TypeError):  # there is no report, or it is from another program
            names = []
        inside = [name for name in names if not {"/", "\\"} & {*name}]  # they are removed: none may be outside
        return {"files": [report, *(f"{task.out}/{name}" for name in inside)]}

    @property
    def trace(self) -> Trace:
        """What was read for the output. Raises `Unreadable` if the record is missing or damaged."""
        if "trace" not in self._kept:
            raise Unreadable(f"{self._name}: missing or damaged; run the batch again to make {self._out} again")
        return dict(self._kept["trace"])

    @property
    def outcome(self) -> Outcome:
        """The outcome, as shown by the output's report."""
        shown = self._kept["report"]
        return Outcome("done", views=shown["views"], model=shown["model"], notes=tuple(shown["notes"]))

    def is_current(self, source: Source) -> bool:
        """Checks whether the output exists as written, and was made from the same content with the same options."""
        if self._kept.get("key") != self._key:
            return False
        files = source.files if isinstance(source, Bundle) else {}
        if not matches(self._kept["trace"], files):
            return False
        return all(self._outputs.measure(name) == size for name, size in self._kept["files"].items())

    def remove(self) -> None:
        """Removes the record, and the files of the earlier output with their folder, if there are any."""
        if self._kept:
            self._outputs.remove([self._name, *self._kept["files"]])
            self._outputs.remove_empty_folder(self._out)
            self._kept = {}

    def is_of(self, run: str) -> bool:
        """Checks whether the output was made in that run."""
        return run != "" and bool(self._kept.get("run") == run)

    def write(self, files: dict[str, int], trace: Trace, report: Report) -> Outcome:
        """Records that the output is there. `files`: names and sizes, as returned by `Outputs.move`."""
        shown = {
            "views": len(report["views"]),
            "model": report["model"]["name"] if report["model"] else "",
            "notes": report["notes"],
        }
        self._kept = {"out": self._out, "key": self._key, "run": self._run, "files": files}
        self._kept |= {"trace": trace, "report": shown}
        self._outputs.write(self._name, (json.dumps(self._kept, indent=1) + "\n").encode())
        return self.outcome


def hash_name(out: str) -> str:
    """Returns a file name for the files that belong to the output called `out`."""
    return hashlib.sha256(out.encode()).hexdigest()[:32]


def _parse(data: bytes | None) -> dict[str, Any]:
    """Parses a JSON object; empty for anything else."""
    try:
        found = json.loads(data or b"")
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
