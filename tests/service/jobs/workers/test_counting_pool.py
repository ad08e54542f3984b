import threading

import pytest

from ciir.errors import WorkerDied
from ciir.service.jobs.job import Problem, Request, Result
from ciir.service.jobs.workers.counting_pool import CountingPool
from ciir.service.jobs.workers.task import Hooks, Task
from ciir.service.metrics import Metrics
from tests.support.jobs import StandInPool, read_metrics

TASK = Task("id", Request("upload.png", {}, None, "upscale"), None, None)
RESULT = Result("png", 123, {"timings_ms": {"decode": 3000}, "plan": {"skipped": None}})


def run(metrics, work):
    pool = CountingPool(StandInPool(lambda *_: work()), metrics)
    return pool.run(TASK, Hooks(print, print, threading.Event()))


def test_outcomes_are_counted_by_status():
    def die():
        raise WorkerDied("was ended")

    metrics = Metrics()
    assert run(metrics, lambda: RESULT) is RESULT
    run(metrics, lambda: Problem(415, "T", "d"))
    with pytest.raises(WorkerDied):
        run(metrics, die)
    assert read_metrics(
        metrics,
        'ciir_jobs_ended_total{status="200"}',
        'ciir_jobs_ended_total{status="415"}',
        'ciir_jobs_ended_total{status="WorkerDied"}',
        'ciir_job_seconds_count{kind="upscale"}',
        "ciir_workers_busy",
        "ciir_result_bytes_total",
        'ciir_stage_seconds_total{stage="decode"}',
    ) == [1, 1, 1, 3, 0, 123, 3]
