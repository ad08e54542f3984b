import logging
import os
import threading
import time
from types import SimpleNamespace

import pytest

from ciir.errors import Cancelled, QueueUnavailable
from ciir.service.jobs.job import Job, Problem, Request, Result
from ciir.service.jobs.workers import consumer as module
from ciir.service.jobs.workers.consumer import Consumer
from ciir.service.jobs.workers.consumer_lock import FOLDER
from tests.support.jobs import (
    StandInPool,
    list_files,
    raise_worker_died,
    read_result,
    submit_data,
    wait_for_end,
    write_double,
)
from tests.support.waiting import wait_until


class Gate:
    """Work that waits until the gate is opened, or until it is cancelled."""

    def __init__(self):
        self._opened = threading.Event()
        self._inside = threading.Semaphore(0)
        self.open = self._opened.set

    def __call__(self, task, progress, cancelled):
        self._inside.release()
        wait_until(lambda: self._opened.is_set() or cancelled.is_set())
        if not self._opened.is_set():
            raise Cancelled
        return write_double(task, progress, cancelled)

    def wait_for_task(self):
        assert self._inside.acquire(timeout=30)


@pytest.fixture
def gate(pool):
    pool.work = Gate()
    yield pool.work
    pool.work.open()


def test_jobs_are_run(service, jobs, pool):
    service.start_consumer(jobs, pool, 2)
    ids = [submit_data(jobs, bytes([number])).id for number in range(20)]
    for number, id_ in enumerate(ids):
        job = wait_for_end(jobs, id_)
        assert (job.state, job.attempts) == ("done", 1)
        assert job.result == Result("png", 2, {"timings_ms": {"total": 1.0}}, job.result.sha256)
        assert read_result(jobs, id_) == bytes([number]) * 2
    assert sorted(pool.started) == sorted(ids)
    wait_until(lambda: jobs.queue.active.items() == {})
    assert jobs.count_waiting() == 0
    assert len(list_files(jobs)) == 20


def test_small_jobs_do_not_wait_for_large_ones(service, jobs, pool):
    opened = threading.Event()

    def block_large_jobs(task, progress, cancelled):
        if task.request.options.get("views") == "all":
            assert opened.wait(30)
        return write_double(task, progress, cancelled)

    pool.work = block_large_jobs
    large = [submit_data(jobs, bytes([number]), views="all").id for number in range(4)]
    service.start_consumer(jobs, pool, 2)
    for number in range(30):
        assert wait_for_end(jobs, submit_data(jobs, bytes([number])).id).state == "done"
    assert {jobs.get(id_).state for id_ in large} <= {"running", "queued"}
    opened.set()
    assert {wait_for_end(jobs, id_).state for id_ in large} == {"done"}


def wait_until_cancelled(task, progress, cancelled):
    assert cancelled.wait(30)
    raise Cancelled


@pytest.mark.parametrize("threads", [1, 2])
def test_a_job_that_overstays_the_small_lane_is_moved_out_of_it(service, jobs, pool, monkeypatch, threads):
    monkeypatch.setattr(module, "SMALL_SECONDS", 0.3)

    def overstay(task, progress, cancelled):
        is_long = task.request.options.get("views") == "0,0"
        return (wait_until_cancelled if is_long else write_double)(task, progress, cancelled)

    pool.work = overstay
    long = [submit_data(jobs, bytes([number]), views="0,0").id for number in range(threads)]
    assert {jobs.get(id_).lane for id_ in long} == {"small"}
    small = [submit_data(jobs, bytes([number])).id for number in range(2)]
    service.start_consumer(jobs, pool, threads)
    assert {wait_for_end(jobs, id_).state for id_ in small} == {"done"}
    assert sorted(jobs.get(id_).lane for id_ in long) == ["large", "small"][:threads]
    assert {jobs.get(id_).state for id_ in long} <= {"queued", "running"}
    for id_ in long:
        jobs.cancel(id_)


def test_a_job_in_the_small_lane_goes_on_while_none_waits(service, jobs, pool, monkeypatch):
    monkeypatch.setattr(module, "SMALL_SECONDS", 0.0)

    def take_a_second(task, progress, cancelled):
        assert not cancelled.wait(1.0)
        return write_double(task, progress, cancelled)

    pool.work = take_a_second
    service.start_consumer(jobs, pool)
    job = wait_for_end(jobs, submit_data(jobs).id)
    assert (job.state, job.attempts, job.lane) == ("done", 1, "small")


def test_the_log_shows_each_run(service, jobs, pool, caplog):
    def read_fields(id_):
        lines = [record for record in caplog.records if getattr(record, "fields", {}).get("job") == id_]
        return [record.getMessage() for record in lines], [record.fields for record in lines]

    with caplog.at_level(logging.INFO):
        service.start_consumer(jobs, pool)
        done = submit_data(jobs, lenses="5x5").id
        wait_for_end(jobs, done)
        pool.work = lambda task, progress, cancelled: Problem(422, "Takes too long", "not done after 300 s")
        failed = submit_data(jobs, b"2", views="all", model="\n").id
        wait_for_end(jobs, failed)
        pool.work = raise_worker_died
        died = submit_data(jobs, b"3").id
        wait_for_end(jobs, died)
    (begin, end), (fields, at_end) = read_fields(done)
    assert begin.endswith(
        f': reconstruction, run 1 begins in worker process {os.getpid()}, small lane: upload.png {{"lenses": "5x5"}}'
    )
    assert ("reconstruction, after " in end and " s done, 8 bytes" in end, at_end["status"]) == (True, "200")
    assert fields == {"job": done, "kind": "reconstruction", "worker": os.getpid(), "lane": "small", "attempt": 1}
    assert 0 <= at_end["seconds"] < 30
    (begin, end), (fields, at_end) = read_fields(failed)
    assert 'large lane: upload.png {"views": "all", "model": "\\n"}' in begin
    assert ("failed with 422 Takes too long: not done after 300 s" in end, at_end["status"]) == (True, "422")
    texts, fields = read_fields(died)
    assert [line.get("status") for line in fields] == [None, "WorkerDied"] * 2
    assert "the worker process was ended by signal 9 (Killed)" in texts[-1]


@pytest.mark.parametrize("where", ["this process", "another process"])
def test_a_cancelled_job_stops(service, pool, gate, caplog, where):
    jobs = service.open_jobs()
    service.start_consumer(jobs, pool)
    job = submit_data(jobs)
    gate.wait_for_task()
    with caplog.at_level(logging.INFO):
        (jobs if where == "this process" else service.open_jobs()).cancel(job.id)
        wait_until(lambda: jobs.files.list_runs() == [])  # the gate is closed: the task was cancelled
        wait_until(lambda: "stopped: it was cancelled, or taken over by another consumer" in caplog.text)
    assert "the server stops" not in caplog.text
    gate.open()
    assert wait_for_end(jobs, submit_data(jobs, b"later").id).state == "done"
    assert [event.kind for event in jobs.get(job.id).events] == ["queued", "running", "cancelled"]


def test_the_first_and_the_newest_progress_are_stored(service, jobs, pool):
    opened = threading.Event()

    def report_often(task, progress, cancelled):
        for number in range(1000):
            progress({"stage": "map", "views_done": number, "views": 1000})
        assert opened.wait(30)
        return write_double(task, progress, cancelled)

    def list_progress():
        return [event.data["views_done"] for event in jobs.get(job.id).events if event.kind == "progress"]

    pool.work = report_often
    service.start_consumer(jobs, pool)
    job = submit_data(jobs)
    wait_until(lambda: list_progress()[-1:] == [999])
    assert list_progress()[0] == 0
    assert len(list_progress()) <= 4
    opened.set()
    wait_for_end(jobs, job.id)


def test_long_jobs_have_fewer_progress_events(monkeypatch):
    stored, now = [], [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    run = module._Run(Job("an id", Request("upload.png", {}, None)), holds_small=True)
    lifecycle = SimpleNamespace(add_progress=lambda _, data: stored.append(data["views_done"]) or True)
    jobs = SimpleNamespace(lifecycle=lifecycle)
    for number in range(3600 * 4):  # an hour, four times a second
        now[0] = 1000.0 + number / 4
        run.update_progress(jobs, {"views_done": number})
        run.store_progress(jobs)
    assert stored[:240] == list(range(240))
    assert len(stored) < 2000
    assert stored[-1] > 3500 * 4


def test_stop_lets_running_jobs_finish(service, jobs, pool, gate):
    consumer = service.start_consumer(jobs, pool)
    running, waiting = submit_data(jobs, b"a"), submit_data(jobs, b"b")
    gate.wait_for_task()
    stopping = threading.Thread(target=service.stop_consumer, args=(consumer,))
    stopping.start()
    wait_until(consumer._stopping.is_set)
    gate.open()
    stopping.join(30)
    assert jobs.get(running.id).state == "done"
    assert jobs.get(waiting.id).state == "queued"
    assert jobs.queue.list_waiting() == {waiting.id}
    assert jobs.queue.heartbeats.items() == {}


def test_stop_requeues_jobs_that_do_not_finish(service, jobs, pool, gate, caplog):
    consumer = service.start_consumer(jobs, pool, 2)
    ids = [submit_data(jobs, bytes([number])).id for number in range(3)]
    gate.wait_for_task()
    gate.wait_for_task()
    with caplog.at_level(logging.INFO):
        service.stop_consumer(consumer, 0)
    assert caplog.text.count("stopped: the server stops") == 2
    assert "cancelled" not in caplog.text
    assert {jobs.get(id_).state for id_ in ids} == {"queued"}
    assert jobs.queue.list_waiting() == set(ids)
    assert jobs.files.list_runs() == []
    gate.open()
    service.start_consumer(jobs, pool)
    assert {wait_for_end(jobs, id_).state for id_ in ids} == {"done"}


def test_stop_requeues_a_job_that_was_just_taken_off_the_queue(service, jobs, pool, gate, monkeypatch):
    popped, start = threading.Event(), jobs.lifecycle.start

    def start_late(id_, lease):
        popped.set()
        time.sleep(1.0)  # by then `stop` has cancelled all other runs
        return start(id_, lease)

    monkeypatch.setattr(jobs.lifecycle, "start", start_late)
    consumer = service.start_consumer(jobs, pool)
    job = submit_data(jobs)
    assert popped.wait(30)
    service.stop_consumer(consumer, 0)
    assert jobs.get(job.id).state == "queued"


def test_a_consumer_that_was_never_started_stops(jobs, pool):
    Consumer(jobs, pool, 2).stop(0)
    assert list((jobs.folder / FOLDER).iterdir()) == []


def test_the_heartbeat_is_sent_before_anything_else(service, jobs, pool, monkeypatch):
    def fail(ids):
        raise QueueUnavailable("no answer")

    monkeypatch.setattr(jobs.records, "get_many", fail)
    service.start_consumer(jobs, pool)
    wait_until(jobs.queue.heartbeats.items, seconds=10)


def test_consumers_share_the_jobs(service, queue_url):
    barrier = threading.Barrier(2)

    def wait_for_other(task, progress, cancelled):
        barrier.wait(30)
        return write_double(task, progress, cancelled)

    pools = [StandInPool(wait_for_other), StandInPool(wait_for_other)]
    jobs = service.open_jobs(queue=queue_url)
    for pool in pools:
        service.start_consumer(service.open_jobs(queue=queue_url), pool)
    ids = [submit_data(jobs, bytes([number])).id for number in range(6)]
    assert {wait_for_end(jobs, id_).state for id_ in ids} == {"done"}
    assert [len(pool.started) for pool in pools] == [3, 3]  # neither continues without the other
    assert sorted(pools[0].started + pools[1].started) == sorted(ids)


@pytest.mark.usefixtures("retries_at_once")
def test_redis_stops_and_restarts(service, pool, gate, redis_server, caplog):
    jobs = service.open_jobs(queue=redis_server.url)
    service.start_consumer(jobs, pool)
    ids = [submit_data(jobs, bytes([number])).id for number in range(3)]
    gate.wait_for_task()
    redis_server.kill()
    with caplog.at_level(logging.WARNING):
        gate.open()
        wait_until(lambda: "the queue: " in caplog.text)
        redis_server.start()
        wait_until(lambda: "the queue can be used again" in caplog.text)
    assert [wait_for_end(jobs, id_).state for id_ in ids] == ["done"] * 3
    assert sorted(pool.started) == sorted(ids)  # the job that ended meanwhile was not run again
