"""What a consumer does beside the jobs: it stops them in time, and never sweeps for so long that it seems dead."""

import threading

import pytest

from ciir.errors import Cancelled, QueueUnavailable
from ciir.service.jobs import jobs as module


def test_a_job_that_was_just_taken_off_the_queue_is_put_back_too(service, jobs, pool, helpers, monkeypatch):
    taken, stopped, begin = threading.Event(), threading.Event(), jobs.lifecycle.begin

    def begin_late(id_, claim):
        taken.set()
        assert not stopped.wait(1.0)  # by then `stop` has told all that ran to end
        return begin(id_, claim)

    def work_until_told(work, progress, cancelled):
        if not cancelled.wait(30):
            raise AssertionError("nobody told it to end")
        raise Cancelled

    monkeypatch.setattr(jobs.lifecycle, "begin", begin_late)
    pool.work = work_until_told
    consumer = service.consumer(jobs, pool)
    job = helpers.submit(jobs)
    assert taken.wait(30)
    service.stop(consumer, 0)
    stopped.set()
    assert jobs.get(job.id).state == "queued"


@pytest.mark.parametrize("change", ["old", "clock set back"])
def test_a_sweep_that_takes_long_stops_and_goes_on_later(service, helpers, monkeypatch, change):
    jobs = service.jobs(keep_seconds=100)
    now = [1000.0, 0.0]
    monkeypatch.setattr(module.time, "time", lambda: now[0])
    ids = [helpers.submit(jobs, bytes([number])).id for number in range(4)]
    for id_ in ids:
        jobs.cancel(id_)
    touched = []

    def slow(function):
        def wrapper(name, *args):
            touched.append(name)
            now[1] += module.MOST_SWEEP_SECONDS
            return function(name, *args)

        return wrapper

    monkeypatch.setattr(jobs, "_forget", slow(jobs._forget))
    monkeypatch.setattr(jobs.lifecycle, "keep", slow(jobs.lifecycle.keep))
    monkeypatch.setattr(module.time, "monotonic", lambda: now[1])
    now[0] = 2000.0 if change == "old" else 500.0
    assert jobs.sweep() is False
    assert len(touched) == 2
    assert jobs.sweep() is True
    assert sorted(name.partition(".")[0] for name in touched) == sorted(ids)
    if change == "old":
        assert [jobs.get(id_) for id_ in ids] == [None] * 4


def test_it_says_that_it_lives_before_anything_else(service, jobs, pool, helpers, monkeypatch):
    def fail(ids):
        raise QueueUnavailable("no answer")

    monkeypatch.setattr(jobs.records, "many", fail)
    service.consumer(jobs, pool)
    helpers.until(jobs.queue.beats.items, seconds=10)
