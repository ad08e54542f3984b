"""The summary of a batch: the outcome of each input, as JSON and as CSV."""

from __future__ import annotations

import csv
import io
import json
import time
from collections import Counter
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.service.batch.places import Outputs
    from ciir.service.batch.task import Outcome, Task

JSON, CSV = "summary.json", "summary.csv"
COLUMNS = ("input", "output", "status", "error", "views", "model", "seconds", "notes")
NOT_DONE = "not done"
"""The status of an input that was not reached."""


class Summary:
    """The outcomes of the tasks so far."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._tasks = tasks
        self._outcomes: dict[str, Outcome] = {}
        self._begun = time.monotonic()

    def add(self, task: Task, outcome: Outcome) -> None:
        """Adds an outcome."""
        self._outcomes[task.whole or task.out] = outcome

    def count(self) -> Counter[str]:
        """Counts the inputs with each status."""
        return Counter(row["status"] for row in self._list_rows())

    def describe(self) -> dict[str, Any]:
        """Returns the summary, ready for JSON."""
        counts = self.count()
        return {
            "version": version("ciir"),
            "seconds": round(time.monotonic() - self._begun, 3),
            "inputs": len(self._tasks),
            **{status.replace(" ", "_"): counts[status] for status in ("done", "kept", "failed", NOT_DONE)},
            "results": self._list_rows(),
        }

    def write(self, outputs: Outputs) -> None:
        """Writes both files."""
        described = self.describe()
        outputs.write(JSON, (json.dumps(described, indent=1, ensure_ascii=False) + "\n").encode())
        table = io.StringIO()
        writer = csv.DictWriter(table, COLUMNS)
        writer.writeheader()
        writer.writerows({**row, "notes": " | ".join(row["notes"])} for row in described["results"])
        outputs.write(CSV, table.getvalue().encode())

    def _list_rows(self) -> list[dict[str, Any]]:
        return [self._make_row(task) for task in self._tasks]

    def _make_row(self, task: Task) -> dict[str, Any]:
        row = {"input": task.source, "output": task.out, "status": NOT_DONE, "error": "", "views": 0, "model": ""}
        outcome = self._outcomes.get(task.out)
        if outcome is None:
            return row | {"seconds": 0.0, "notes": []}
        names = ("status", "error", "views", "model", "seconds")
        return row | {name: getattr(outcome, name) for name in names} | {"notes": list(outcome.notes)}
