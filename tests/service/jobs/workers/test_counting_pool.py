import threading
import time

import pytest

from ciir.errors import Cancelled, WorkerDied
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


def test_waiting_for_a_worker_process_is_not_its_time():
    """It is not busy either."""
    metrics, begun, busy = Metrics(), [], []

    class SlowPool:
        def run(self, task, hooks):
            time.sleep(0.3)
            busy.extend(read_metrics(metrics, "ciir_workers_busy"))
            for pid in (1, 2):  # the second runs it anew
                hooks.begun(pid)
                busy.extend(read_metrics(metrics, "ciir_workers_busy"))
            return RESULT

    CountingPool(SlowPool(), metrics).run(TASK, Hooks(begun.append, print, threading.Event()))
    assert (begun, busy) == ([1, 2], [0, 1, 1])
    seconds, still_busy = read_metrics(metrics, 'ciir_job_seconds_sum{kind="upscale"}', "ciir_workers_busy")
    assert seconds < 0.3
    assert still_busy == 0


def test_a_task_that_no_worker_process_received_has_no_time():
    class FullPool:
        def run(self, task, hooks):
            raise Cancelled

    metrics = Metrics()
    with pytest.raises(Cancelled):
        CountingPool(FullPool(), metrics).run(TASK, Hooks(print, print, threading.Event()))
    assert read_metrics(metrics, 'ciir_jobs_ended_total{status="Cancelled"}', "ciir_workers_busy") == [1, 0]
    assert b'ciir_job_seconds_count{kind="upscale"}' not in metrics.text()
