import threading

import pytest

from ciir.service.jobs.job import Problem, Result
from ciir.service.metrics import CountingPool, Metrics

REPORT = {
    "timings_ms": {"decode": 1000, "total": 3000},
    "plan": {"skipped": {"pixels": 200, "uniform": 0.25, "repeated": 0.5}},
}


class Pool:
    def __init__(self, outcome):
        self.outcome = outcome

    def run(self, work, *, progress, cancelled):
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome


def values(metrics, *names):
    lines = dict(line.rsplit(" ", 1) for line in metrics.text().decode().splitlines() if not line.startswith("#"))
    return [float(lines[name]) for name in names]


def run(metrics, outcome):
    return CountingPool(Pool(outcome), metrics).run("work", progress=print, cancelled=threading.Event())


def test_a_result_is_counted():
    metrics, result = Metrics(), Result("png", 123, REPORT)
    assert run(metrics, result) is result
    assert run(metrics, Result("png", 1, {"timings_ms": {}, "plan": {"skipped": {"culled": 0.5}}})).size == 1
    found = values(
        metrics,
        'ciir_stage_seconds_total{stage="total"}',
        "ciir_result_bytes_total",
        "ciir_model_pixels_total",
        'ciir_model_pixels_skipped_total{reason="repeated"}',
        'ciir_jobs_ended_total{status="200"}',
        "ciir_job_seconds_count",
        "ciir_workers_busy",
    )
    assert found == [3, 124, 200, 100, 2, 2, 0]


def test_failures_are_counted_by_cause():
    metrics = Metrics()
    run(metrics, Problem(415, "T", "d"))
    with pytest.raises(KeyError):
        run(metrics, KeyError("x"))
    found = values(
        metrics,
        'ciir_jobs_ended_total{status="415"}',
        'ciir_jobs_ended_total{status="KeyError"}',
        "ciir_workers_busy",
        "ciir_result_bytes_total",
    )
    assert found == [1, 1, 0, 0]


def test_instances_do_not_share_counts():
    one, other = Metrics(), Metrics()
    one.sent.inc(5)
    assert values(one, "ciir_http_sent_bytes_total") == [5]
    assert values(other, "ciir_http_sent_bytes_total") == [0]
