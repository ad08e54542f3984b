import logging
import os
import subprocess
import sys
import time

import pytest

from ciir.errors import QueueUnavailable
from ciir.service.jobs.job import Problem
from ciir.service.jobs.workers.consumer_lock import FOLDER, ConsumerLock
from ciir.service.jobs.workers.orphans import ORPHAN_SECONDS
from ciir.service.jobs.workers.recovery import (
    DEAD_SECONDS,
    LOST_SECONDS,
    STALE_SECONDS,
    Recovery,
    create_lease,
)
from tests.support.jobs import list_files, make_result, publish_result, submit_data

DIE_WITH_A_JOB = """
import os, sys
from ciir.service.jobs.jobs import Jobs
from ciir.service.jobs.workers.consumer_lock import ConsumerLock
from ciir.service.jobs.workers.recovery import Recovery, create_lease
from ciir.service.settings import Settings
jobs = Jobs(Settings(folder=sys.argv[1]))
lock = ConsumerLock(jobs.folder)
Recovery(jobs, lock).send_heartbeat()
run = jobs.lifecycle.start(jobs.queue.pop(("small",), 10), create_lease(lock.name, 1))
with jobs.files.open_run(run.input, run.output) as files:
    files.target.write_bytes(b"half")
    os.kill(os.getpid(), 9)
"""


class Clock:
    now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def lock(jobs):
    lock = ConsumerLock(jobs.folder)
    yield lock
    lock.close()


@pytest.fixture
def recovery(jobs, lock, clock):
    recovery = Recovery(jobs, lock, clock)
    recovery.send_heartbeat()
    return recovery


def start_run(jobs, consumer="elsewhere"):
    """Starts the job in the queue, by default for a consumer on another machine."""
    return jobs.lifecycle.start(jobs.queue.pop(("small", "large"), 0.01), create_lease(consumer, 1))


def die_with_a_job(jobs):
    """Starts the job in the queue in a process that is then killed."""
    command = [sys.executable, "-c", DIE_WITH_A_JOB, str(jobs.folder)]
    assert subprocess.run(command, check=False).returncode == -9  # noqa: S603 - our own


@pytest.mark.parametrize("heartbeat", [b"7", None])
def test_a_consumer_without_a_new_heartbeat_is_dead(jobs, recovery, clock, heartbeat):
    job = submit_data(jobs)
    if heartbeat is not None:
        jobs.queue.heartbeats.put("elsewhere", heartbeat)
    run = start_run(jobs)
    files = jobs.files.open_run(run.input, run.output)
    files.__enter__().target.write_bytes(b"half")
    recovery.repair([])
    clock.now += DEAD_SECONDS - 0.1
    recovery.repair([])
    assert jobs.get(job.id).state == "running"
    clock.now += 0.2
    recovery.repair([])
    assert jobs.get(job.id).state == "queued"
    assert jobs.queue.pop(("small",), 0.01) == job.id
    assert jobs.files.list_runs() == []
    assert "elsewhere" not in jobs.queue.heartbeats.items()


def test_no_consumer_is_dead_because_the_queue_was_unavailable(jobs, recovery, clock, monkeypatch):
    def fail(key, value):
        raise QueueUnavailable("no answer")

    job = submit_data(jobs)
    jobs.queue.heartbeats.put("elsewhere", b"7")
    start_run(jobs)
    recovery.repair([])
    clock.now += DEAD_SECONDS - 0.1
    with monkeypatch.context() as patch:
        patch.setattr(jobs.queue.heartbeats, "put", fail)
        with pytest.raises(QueueUnavailable):
            recovery.send_heartbeat()
    clock.now += DEAD_SECONDS
    recovery.repair([])
    assert jobs.get(job.id).state == "running"
    clock.now += DEAD_SECONDS
    recovery.repair([])
    assert jobs.get(job.id).state == "queued"


def test_a_consumer_with_new_heartbeats_is_alive(jobs, recovery, clock):
    job = submit_data(jobs)
    start_run(jobs)
    for count in range(5):
        jobs.queue.heartbeats.put("elsewhere", str(count).encode())
        recovery.repair([])
        clock.now += DEAD_SECONDS - 0.1
    assert jobs.get(job.id).state == "running"


@pytest.mark.parametrize("now", [-1e9, 0.0, 1e9])
def test_the_system_clock_is_not_used(jobs, recovery, clock, monkeypatch, now):
    job = submit_data(jobs)
    jobs.queue.heartbeats.put("elsewhere", b"7")
    start_run(jobs)
    recovery.repair([])
    monkeypatch.setattr("time.time", lambda: now)
    recovery.repair([])
    assert jobs.get(job.id).state == "running"
    clock.now += DEAD_SECONDS
    recovery.repair([])
    assert jobs.get(job.id).state == "queued"


def test_a_killed_consumer_on_this_machine_is_dead_at_once(jobs, recovery):
    job = submit_data(jobs)
    die_with_a_job(jobs)
    assert jobs.get(job.id).state == "running"
    assert len(list_files(jobs)) == 2
    recovery.repair([])
    recovery.remove_leftovers()
    assert jobs.get(job.id).state == "queued"
    assert jobs.queue.pop(("small",), 0.01) == job.id
    assert list_files(jobs) == [f"inputs/{job.input}"]
    assert jobs.files.list_runs() == []
    assert len(list((jobs.folder / FOLDER).iterdir())) == 1


def test_the_files_of_a_cancelled_run_of_a_killed_consumer_are_removed(jobs, recovery):
    job = submit_data(jobs)
    die_with_a_job(jobs)
    jobs.cancel(job.id)
    assert len(jobs.files.list_runs()) == 1
    recovery.repair([])
    recovery.remove_leftovers()
    assert jobs.files.list_runs() == []


def test_a_job_that_is_not_in_the_queue_is_put_back_once(jobs, recovery, clock, caplog):
    job = submit_data(jobs)
    assert jobs.queue.pop(("small",), 0.01) == job.id  # as if the consumer died before it got the lease
    recovery.repair([])
    clock.now += LOST_SECONDS - 0.1
    recovery.repair([])
    assert jobs.queue.list_waiting() == set()
    clock.now += 0.1
    with caplog.at_level(logging.WARNING):
        recovery.repair([])
    assert job.id in caplog.text
    clock.now += 10 * LOST_SECONDS
    recovery.repair([])
    recovery.repair([])
    assert jobs.count_waiting() == 1


def test_a_run_of_this_consumer_that_no_thread_holds(jobs, recovery, lock, clock):
    job = submit_data(jobs)
    run = start_run(jobs, lock.name)
    for _ in range(3):
        recovery.repair([run.lease])
        clock.now += 10 * DEAD_SECONDS
    assert jobs.get(job.id).state == "running"
    recovery.repair([])
    clock.now += LOST_SECONDS
    recovery.repair([])
    assert jobs.get(job.id).state == "queued"


@pytest.mark.parametrize("which", ["input without a job", "input of an earlier job"])
def test_an_input_without_a_job_is_removed(jobs, recovery, clock, which):
    job = submit_data(jobs)
    name = "0" * 32 + ".1" if which == "input without a job" else job.id + ".1"
    jobs.queue.active.put(name, b"{}")
    (jobs.folder / "files" / "inputs" / name).write_bytes(b"x")
    (jobs.folder / "files" / "runs" / f"{name}.partial").write_bytes(b"x")
    recovery.repair([])
    clock.now += STALE_SECONDS - 1
    recovery.repair([])
    assert len(list_files(jobs)) == 3
    clock.now += 1
    recovery.repair([])
    assert list_files(jobs) == [f"inputs/{job.input}"]
    assert list(jobs.queue.active.items()) == [job.input]


@pytest.mark.parametrize("is_old", [True, False])
def test_old_files_without_a_job_are_removed(jobs, recovery, is_old):
    done, waiting = submit_data(jobs), submit_data(jobs, b"waiting")
    run = jobs.lifecycle.start(done.id, "elsewhere-1")
    publish_result(jobs, run)
    assert jobs.lifecycle.finish(run, make_result())
    known = [f"inputs/{waiting.input}", f"results/{run.output}"]
    assert list_files(jobs) == known
    for folder, name in (
        ("results", f"{done.id}.elsewhere-2"),
        ("results", "ffff.elsewhere-3"),
        ("inputs", f"{waiting.id}.1"),
        ("inputs", "ffff.1"),
    ):
        (jobs.folder / "files" / folder / name).write_bytes(b"x")
    if is_old:
        for name in list_files(jobs):
            os.utime(jobs.folder / "files" / name, (0, time.time() - ORPHAN_SECONDS - 60))
    recovery.repair([])
    recovery.remove_leftovers()
    assert len(list_files(jobs)) == (2 if is_old else 6)
    assert set(known) <= set(list_files(jobs))


def test_an_ended_job_that_was_not_settled_is_settled(jobs, recovery, monkeypatch):
    run = jobs.lifecycle.start(submit_data(jobs).id, "elsewhere-1")
    with monkeypatch.context() as patch:
        patch.setattr(jobs.lifecycle, "settle", lambda job: None)  # as if the process died here
        assert jobs.lifecycle.finish(run, Problem(422, "Title", "detail"))
    assert len(list_files(jobs)) == 1
    recovery.repair([])
    assert list_files(jobs) == []
    assert jobs.queue.active.items() == {}
    assert list(jobs.queue.finished.items()) == [run.input]


def test_two_consumers_requeue_a_job_once(service, jobs, recovery, clock):
    job = submit_data(jobs)
    jobs.queue.heartbeats.put("elsewhere", b"7")
    start_run(jobs)
    other_lock = ConsumerLock(jobs.folder)
    other = Recovery(service.open_jobs(), other_lock, clock)
    other.send_heartbeat()
    for seconds in (0, DEAD_SECONDS):
        clock.now += seconds
        recovery.repair([])
        other.repair([])
    assert jobs.count_waiting() == 1
    assert [event.kind for event in jobs.get(job.id).events] == ["queued", "running", "queued"]
    other_lock.close()
