"""Metrics of the tasks that a pool runs."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

from ciir.service.jobs.job import Problem

if TYPE_CHECKING:
    from ciir.service.jobs.workers.pool import Pool
    from ciir.service.jobs.workers.task import Hooks, Outcome, Task
    from ciir.service.metrics import Metrics


class CountingPool:
    """A pool that counts its tasks in `metrics`."""

    def __init__(self, pool: Pool, metrics: Metrics) -> None:
        self._pool, self._metrics = pool, metrics

    def run(self, task: Task, hooks: Hooks) -> Outcome:
        """Runs `task` as the pool does. Its time begins when a worker process has received it."""
        started: float | None = None
        status = ""

        def begin(pid: int) -> None:
            nonlocal started
            if started is None:  # another process may run the task anew
                started = time.perf_counter()
                self._metrics.busy.inc()
            hooks.begun(pid)

        try:
            outcome = self._pool.run(task, replace(hooks, begun=begin))
            status = str(outcome.status) if isinstance(outcome, Problem) else "200"
        except BaseException as error:
            status = type(error).__name__
            raise
        finally:
            if started is not None:
                self._metrics.busy.dec()
                self._metrics.seconds.labels(task.request.kind).observe(time.perf_counter() - started)
            self._metrics.ended.labels(status).inc()
        if not isinstance(outcome, Problem):
            self._metrics.count_result(outcome.size, outcome.report)
        return outcome
