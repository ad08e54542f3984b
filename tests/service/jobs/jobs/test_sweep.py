"""What is removed, and when."""

import time

import pytest

from ciir.service.jobs import jobs as module
from tests.support.jobs import fail_job, finish_job, list_files, read_result, set_clock, submit_data


def test_the_least_recently_used_are_removed_first(service, monkeypatch):
    jobs = service.open_jobs(keep_bytes=5000)
    ids = []
    for number in range(4):
        set_clock(monkeypatch, 1000.0 + number)
        ids.append(finish_job(jobs, submit_data(jobs, bytes([number])), bytes(1500)).id)
    set_clock(monkeypatch, 1010.0)
    read_result(jobs, ids[0])
    jobs.sweep()
    assert all(jobs.get(id_) for id_ in ids)  # all were used just now
    set_clock(monkeypatch, 1010.0 + module.MIN_KEEP_SECONDS)
    jobs.sweep()
    assert [jobs.get(id_) is not None for id_ in ids] == [True, False, False, True]
    assert len(list_files(jobs)) == len(jobs.queue.finished.items()) == 2
    jobs.sweep()
    assert len(jobs.queue.finished.items()) == 2


def test_the_number_of_ended_jobs_is_limited(service, monkeypatch):
    monkeypatch.setattr(module, "FINISHED_LIMIT", 3)
    jobs = service.open_jobs()
    set_clock(monkeypatch, 1000.0)
    ids = [finish_job(jobs, submit_data(jobs, bytes([number]))).id for number in range(4)]
    set_clock(monkeypatch, 1001.0 + module.MIN_KEEP_SECONDS)
    submit_data(jobs, bytes([0]))
    jobs.sweep()
    assert [jobs.get(id_) is not None for id_ in ids].count(True) == 3
    assert jobs.get(ids[0]) is not None


def test_ended_jobs_are_removed_while_the_server_of_the_queue_is_short_of_memory(jobs, monkeypatch):
    set_clock(monkeypatch, 1000.0)
    ids = [finish_job(jobs, submit_data(jobs, bytes([number]))).id for number in range(3)]
    waiting = submit_data(jobs, b"waiting")
    set_clock(monkeypatch, 1001.0 + module.MIN_KEEP_SECONDS)
    new = finish_job(jobs, submit_data(jobs, b"new")).id
    answers = [False, True, True, False]
    monkeypatch.setattr(jobs.queue, "is_short_of_memory", lambda: answers.pop(0))
    jobs.sweep()
    assert all(jobs.get(id_) for id_ in ids)
    jobs.sweep()
    assert [jobs.get(id_) is not None for id_ in (*ids, waiting.id, new)].count(False) == 2
    assert None not in (jobs.get(waiting.id), jobs.get(new))
    monkeypatch.setattr(jobs.queue, "is_short_of_memory", lambda: True)
    jobs.sweep()
    assert [jobs.get(id_) for id_ in ids] == [None] * 3
    assert jobs.get(new) is not None  # it was used within the last minute


def test_unused_jobs_expire(service, monkeypatch):
    jobs = service.open_jobs(keep_seconds=100)
    set_clock(monkeypatch, 1000.0)
    old, used, bad = (submit_data(jobs, data) for data in (b"old", b"used", b"bad"))
    for job in (old, used):
        finish_job(jobs, job)
    fail_job(jobs, bad, 422)
    set_clock(monkeypatch, 1090.0)
    submit_data(jobs, b"used")
    assert submit_data(jobs, b"bad").state == "failed"  # which does not prolong it
    waiting = submit_data(jobs, b"waiting")
    set_clock(monkeypatch, 1101.0)
    jobs.sweep()
    assert [jobs.get(job.id) is not None for job in (old, used, bad, waiting)] == [False, True, False, True]
    set_clock(monkeypatch, 9999.0)
    jobs.sweep()
    assert jobs.get(waiting.id) == waiting  # queued and running jobs never expire
    assert list_files(jobs) == [f"inputs/{waiting.input}"]


def test_a_system_clock_that_is_set_back(service, monkeypatch):
    jobs = service.open_jobs(keep_seconds=100)
    set_clock(monkeypatch, 10_000.0)
    before = finish_job(jobs, submit_data(jobs, b"before"))
    waiting = submit_data(jobs, b"waiting")
    set_clock(monkeypatch, 50.0)
    jobs.sweep()
    after = finish_job(jobs, submit_data(jobs, b"after"))
    assert read_result(jobs, after.id) == b"result"
    assert finish_job(jobs, waiting).state == "done"
    set_clock(monkeypatch, 140.0)
    jobs.sweep()
    assert jobs.get(before.id) is not None
    set_clock(monkeypatch, 151.0)  # its age counts from when the clock was set back
    jobs.sweep()
    assert jobs.get(before.id) is None
    assert jobs.get(after.id) is None


def test_a_job_that_was_submitted_again_does_not_expire(service, monkeypatch):
    jobs = service.open_jobs(keep_seconds=100)
    set_clock(monkeypatch, 1000.0)
    job = fail_job(jobs, submit_data(jobs), 503)
    again = submit_data(jobs)
    set_clock(monkeypatch, 2000.0)
    jobs.sweep()  # the failed submission has expired
    assert jobs.get(job.id) == again
    assert read_result(jobs, finish_job(jobs, again, lease="c-2").id) == b"result"


@pytest.mark.parametrize("change", ["old", "clock set back"])
def test_a_long_sweep_stops_and_continues_later(service, monkeypatch, change):
    jobs = service.open_jobs(keep_seconds=100)
    now = [1000.0, 0.0]
    monkeypatch.setattr(time, "time", lambda: now[0])
    ids = [submit_data(jobs, bytes([number])).id for number in range(4)]
    for id_ in ids:
        jobs.cancel(id_)
    names = []

    def slow_down(function):
        def call(name, *args):
            names.append(name)
            now[1] += module.SWEEP_LIMIT_SECONDS
            return function(name, *args)

        return call

    monkeypatch.setattr(jobs, "_expire", slow_down(jobs._expire))
    monkeypatch.setattr(jobs.lifecycle, "store_use", slow_down(jobs.lifecycle.store_use))
    monkeypatch.setattr(time, "monotonic", lambda: now[1])
    now[0] = 2000.0 if change == "old" else 500.0
    assert jobs.sweep() is False
    assert len(names) == 2
    assert jobs.sweep() is True
    assert sorted(name.partition(".")[0] for name in names) == sorted(ids)
    if change == "old":
        assert [jobs.get(id_) for id_ in ids] == [None] * 4
