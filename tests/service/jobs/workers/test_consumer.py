import errno
import logging
import os
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from ciir.errors import Cancelled, WorkerDied
from ciir.service.jobs.job import Problem, Result
from ciir.service.jobs.lifecycle import KILLER
from ciir.service.jobs.workers import consumer as module
from ciir.service.jobs.workers import recovery
from ciir.service.jobs.workers.consumer import FAULT, Consumer


class Gate:
    """Work that waits to be let through, or to be stopped."""

    def __init__(self, pool):
        self.pool, self._open = pool, threading.Event()
        self.inside = threading.Semaphore(0)

    def __call__(self, work, progress, cancelled):
        self.inside.release()
        while not self._open.wait(0.005):
            if cancelled.is_set():
                raise Cancelled
        return self.pool.double(work, progress, cancelled)

    def wait(self):
        assert self.inside.acquire(timeout=30)

    def open(self):
        self._open.set()


@pytest.fixture
def gate(pool):
    pool.work = Gate(pool)
    yield pool.work
    pool.work.open()


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(module, "RETRY_SECONDS", 0.01)


def result(jobs, id_):
    with jobs.open_result(id_) as file:
        return file.read()


def kinds(job):
    return [event.kind for event in job.events]


def test_jobs_are_done(service, jobs, pool, helpers):
    service.consumer(jobs, pool, 2)
    ids = [helpers.submit(jobs, bytes([number])).id for number in range(20)]
    for number, id_ in enumerate(ids):
        job = helpers.wait(jobs, id_)
        assert (job.state, job.attempts) == ("done", 1)
        assert job.result == Result("png", 2, {"timings_ms": {"total": 1.0}})
        assert result(jobs, id_) == bytes([number]) * 2
    assert sorted(pool.begun) == sorted(ids)
    helpers.until(lambda: jobs.queue.active.items() == {})
    assert (jobs.waiting(), jobs.running()) == (0, 0)
    assert len(helpers.all_files(jobs.folder)) == 20


def test_two_identical_ones_at_once_are_done_once(service, jobs, pool, gate, helpers):
    service.consumer(jobs, pool, 2)
    first = helpers.submit(jobs)
    gate.wait()
    assert helpers.submit(jobs).id == first.id
    gate.open()
    assert helpers.wait(jobs, first.id).state == "done"
    assert helpers.submit(jobs).state == "done"
    assert pool.begun == [first.id]


def test_small_ones_do_not_wait_behind_large_ones(service, jobs, pool, helpers):
    opened = threading.Event()

    def work(work, progress, cancelled):
        if work.request.options.get("views") == "all":
            assert opened.wait(30)
        return pool.double(work, progress, cancelled)

    pool.work = work
    large = [helpers.submit(jobs, bytes([number]), views="all").id for number in range(4)]
    service.consumer(jobs, pool, 2)
    for number in range(30):
        assert helpers.wait(jobs, helpers.submit(jobs, bytes([number])).id).state == "done"
    assert {jobs.get(id_).state for id_ in large} <= {"running", "queued"}
    opened.set()
    assert {helpers.wait(jobs, id_).state for id_ in large} == {"done"}


@pytest.mark.parametrize("problem", [Problem(422, "Not readable", "no file"), Problem(503, "No room", "full")])
def test_a_problem_is_the_jobs_end(service, jobs, pool, helpers, problem):
    def work(work, progress, cancelled):
        work.target.write_bytes(b"a part")
        return problem

    pool.work = work
    service.consumer(jobs, pool)
    job = helpers.wait(jobs, helpers.submit(jobs).id)
    assert (job.state, job.problem) == ("failed", problem)
    helpers.until(lambda: helpers.all_files(jobs.folder) == [])


def test_what_nobody_foresaw_fails_the_job_and_is_logged(service, jobs, pool, helpers, caplog):
    def work(work, progress, cancelled):
        raise ZeroDivisionError

    pool.work = work
    service.consumer(jobs, pool)
    with caplog.at_level(logging.ERROR):
        job = helpers.wait(jobs, helpers.submit(jobs).id)
    assert job.problem == FAULT
    assert "ZeroDivisionError" in caplog.text
    pool.work = pool.double
    assert helpers.wait(jobs, helpers.submit(jobs).id, "done").attempts == 1


@pytest.mark.usefixtures("impatient")
def test_a_fault_while_an_end_is_told_ends_no_thread(service, pool, helpers, monkeypatch, caplog):
    jobs = service.jobs()
    monkeypatch.setattr(recovery, "STRAY_SECONDS", 0.0)
    pool.work = lambda work, progress, cancelled: Problem(422, "Title", float("nan"))  # which JSON can't hold
    service.consumer(jobs, pool)
    job = helpers.submit(jobs)
    with caplog.at_level(logging.ERROR):
        helpers.until(lambda: "ValueError" in caplog.text)
    pool.work = pool.double
    assert helpers.wait(jobs, job.id).state == "done"


def test_a_disk_that_is_full_when_the_result_is_kept(service, jobs, pool, helpers, monkeypatch):
    move = Path.replace

    def full(path, target):
        if "/results/" in str(target):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return move(path, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", full)
        service.consumer(jobs, pool)
        job = helpers.wait(jobs, helpers.submit(jobs).id)
    assert (job.state, job.problem.status) == ("failed", 503)
    assert "No space left" in job.problem.detail
    helpers.until(lambda: helpers.all_files(jobs.folder) == [])
    assert helpers.wait(jobs, helpers.submit(jobs).id, "done").attempts == 1


def test_a_worker_that_dies_once(service, jobs, pool, helpers):
    def work(work, progress, cancelled):
        work.target.write_bytes(b"half")
        if len(pool.begun) == 1:
            raise WorkerDied("was killed by SIGKILL")
        return pool.double(work, progress, cancelled)

    pool.work = work
    service.consumer(jobs, pool)
    job = helpers.wait(jobs, helpers.submit(jobs).id)
    assert (job.state, job.attempts, job.deaths) == ("done", 2, 1)
    assert kinds(job) == ["queued", "running", "queued", "running", "done"]
    assert result(jobs, job.id) == b"datadata"


def test_a_worker_that_dies_twice(service, jobs, pool, helpers):
    def work(work, progress, cancelled):
        raise WorkerDied("was killed by SIGKILL")

    pool.work = work
    service.consumer(jobs, pool)
    job = helpers.wait(jobs, helpers.submit(jobs).id)
    assert (job.state, job.problem, job.attempts) == ("failed", KILLER, 2)


@pytest.mark.parametrize("where", ["here", "in another process"])
def test_a_job_that_is_cancelled_stops(service, pool, gate, helpers, where):
    jobs = service.jobs()
    service.consumer(jobs, pool)
    job = helpers.submit(jobs)
    gate.wait()
    (jobs if where == "here" else service.jobs()).cancel(job.id)
    helpers.until(lambda: jobs.files.runs() == [])  # the gate stayed shut: the work was stopped
    gate.open()
    later = helpers.submit(jobs, b"later")
    assert helpers.wait(jobs, later.id).state == "done"
    assert kinds(jobs.get(job.id)) == ["queued", "running", "cancelled"]


def test_progress_is_told_and_bounded(service, jobs, pool, helpers):
    gone_on = threading.Event()

    def work(work, progress, cancelled):
        for number in range(1000):
            progress({"stage": "map", "views_done": number, "views": 1000})
        assert gone_on.wait(30)
        return pool.double(work, progress, cancelled)

    def told():
        return [event.data["views_done"] for event in jobs.get(job.id).events if event.kind == "progress"]

    pool.work = work
    service.consumer(jobs, pool)
    job = helpers.submit(jobs)
    helpers.until(lambda: told()[-1:] == [999])  # the newest isn't lost
    assert told()[0] == 0
    assert len(told()) <= 4
    gone_on.set()
    helpers.wait(jobs, job.id)


def test_stopping_lets_what_runs_finish(service, jobs, pool, gate, helpers):
    consumer = service.consumer(jobs, pool)
    running, waiting = helpers.submit(jobs, b"a"), helpers.submit(jobs, b"b")
    gate.wait()
    stopping = threading.Thread(target=service.stop, args=(consumer,))
    stopping.start()
    helpers.until(consumer._stopping.is_set)
    gate.open()
    stopping.join(30)
    assert jobs.get(running.id).state == "done"
    assert jobs.get(waiting.id).state == "queued"
    assert jobs.queue.contents() == {waiting.id}
    assert jobs.queue.beats.items() == {}


def test_stopping_puts_back_what_does_not_finish(service, jobs, pool, gate, helpers):
    consumer = service.consumer(jobs, pool, 2)
    ids = [helpers.submit(jobs, bytes([number])).id for number in range(3)]
    gate.wait()
    gate.wait()
    service.stop(consumer, 0)
    assert {jobs.get(id_).state for id_ in ids} == {"queued"}
    assert jobs.queue.contents() == set(ids)
    assert jobs.files.runs() == []
    gate.open()
    service.consumer(jobs, pool)
    assert {helpers.wait(jobs, id_).state for id_ in ids} == {"done"}


def test_progress_of_long_work_is_told_less_and_less_often(monkeypatch):
    told, now = [], [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    run = module._Run(None)
    jobs = SimpleNamespace(lifecycle=SimpleNamespace(progress=lambda _, data: told.append(data["views_done"]) or True))
    for number in range(3600 * 4):  # an hour, looked at four times a second
        now[0] = 1000.0 + number / 4
        run.tell(jobs, {"views_done": number})
        run.pass_on(jobs)
    assert told[:240] == list(range(240))
    assert len(told) < 2000
    assert told[-1] > 3500 * 4


def test_one_that_was_never_started_stops(jobs, pool):
    Consumer(jobs, pool, 2).stop(0)
    assert list((jobs.folder / "owners").iterdir()) == []


def test_consumers_share_the_work(service, jobs, helpers, queue_url):
    pools = [helpers.Pool(), helpers.Pool()]
    begun = threading.Barrier(2)
    for pool in pools:
        pool.work = lambda work, progress, cancelled: (begun.wait(30), helpers.Pool.double(work, progress, cancelled))[
            1
        ]
        service.consumer(service.jobs(queue=queue_url), pool)
    ids = [helpers.submit(service.jobs(queue=queue_url), bytes([number])).id for number in range(6)]
    asked = service.jobs(queue=queue_url)
    assert {helpers.wait(asked, id_).state for id_ in ids} == {"done"}
    assert [len(pool.begun) for pool in pools] == [3, 3]  # neither goes on without the other
    assert sorted(pools[0].begun + pools[1].begun) == sorted(ids)


@pytest.mark.usefixtures("impatient")
def test_redis_goes_and_comes_back(service, gate, redis_server, helpers, caplog):
    pool = gate.pool
    jobs = service.jobs(queue=redis_server.url)
    service.consumer(jobs, pool)
    ids = [helpers.submit(jobs, bytes([number])).id for number in range(3)]
    gate.wait()
    redis_server.kill()
    with caplog.at_level(logging.WARNING):
        gate.open()
        helpers.until(lambda: "the queue: " in caplog.text)
        redis_server.start()
        helpers.until(lambda: "the queue can be used again" in caplog.text)
    assert [helpers.wait(jobs, id_).state for id_ in ids] == ["done"] * 3
    assert sorted(pool.begun) == sorted(ids)  # the one that was done meanwhile isn't done again


def test_the_clock_is_set_back_while_jobs_run(service, pool, gate, helpers, monkeypatch):
    jobs = service.jobs()
    service.consumer(jobs, pool)
    ids = [helpers.submit(jobs, bytes([number])).id for number in range(3)]
    gate.wait()
    monkeypatch.setattr("time.time", lambda: 5.0)
    jobs.sweep()
    gate.open()
    assert [helpers.wait(jobs, id_).state for id_ in ids] == ["done"] * 3
    jobs.sweep()
    assert [result(jobs, id_) for id_ in ids] == [bytes([number]) * 2 for number in range(3)]
    assert [jobs.get(id_).attempts for id_ in ids] == [1, 1, 1]
