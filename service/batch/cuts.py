"""The tasks of a batch that are made in parts, and are joined when all parts are finished."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ciir.service.batch.parts import list_part_tasks

if TYPE_CHECKING:
    from ciir.service.batch.task import Outcome, Task


@dataclass
class _Whole:
    task: Task
    left: int
    """Number of parts that have not ended."""
    seconds: float
    failed: Outcome | None = None


class Cuts:
    """Keeps track of the tasks that are made in parts."""

    def __init__(self) -> None:
        self._wholes: dict[str, _Whole] = {}
        """Tasks by the names of their outputs."""

    def follow(self, task: Task, outcome: Outcome) -> tuple[list[Task], Outcome | None]:
        """Returns the tasks that follow from the outcome of a task, and the outcome of its input if that has ended."""
        if outcome.status == "cut":
            self._wholes[task.out] = _Whole(replace(task, joined=outcome.parts), len(outcome.parts), outcome.seconds)
            return list_part_tasks(task, outcome.parts), None
        whole = self._wholes.get(task.whole or task.out)
        if whole is None:
            return [], outcome
        whole.seconds += outcome.seconds
        if task.part is not None:
            whole.left -= 1
            whole.failed = outcome if outcome.status == "failed" else whole.failed
            if whole.left:
                return [], None
            if whole.failed is None:
                return [whole.task], None
        del self._wholes[task.whole or task.out]
        return [], replace(whole.failed or outcome, seconds=round(whole.seconds, 3))
