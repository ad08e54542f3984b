"""The scheduler with simulated workers."""

from ciir.benchmarks.batch.simulation import Result


def test_a_scheduler_feeds_as_many_workers_as_fit_its_time():
    found = Result(tasks=100, workers=4, mean_ms=10.0, seconds=1.0, scheduler_ms=2.0, client_ms=1.0)
    assert [found.count_workers(seconds) for seconds in (0.01, 0.1, 1.0)] == [5, 50, 500]
