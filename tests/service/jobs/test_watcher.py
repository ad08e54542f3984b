"""Waiting for changes: notified, with one read for all that wait."""

import asyncio

import pytest
import redis

from ciir.errors import QueueUnavailable
from ciir.service.jobs.job import Event, Job, Request
from ciir.service.jobs.queue import Queue
from ciir.service.jobs.records import Records
from ciir.service.jobs.watcher import Watcher

NEW = Job("a", Request("upload.png", {}, None), events=(Event("queued"),))
WAITING = 500


def create(job):
    return NEW if job is None else None


def add_event(job):
    return job.add_event(Event("running"), state="running")


def run_async(coroutine):
    asyncio.run(asyncio.wait_for(coroutine, 10))


@pytest.fixture
def records(queue):
    queue.poll_seconds = (60.0, 60.0)  # so that only a notification can end a wait in time
    records = Records(queue.jobs)
    records.update("a", create)
    return records


@pytest.fixture
def watcher(records, queue):
    return Watcher(records, queue)


def start_waiting(watcher, count=1):
    return [asyncio.create_task(watcher.wait_for_change("a", 1)) for _ in range(count)]


async def settle(reads):
    """Waits until something and then no more is read."""
    before = -1
    while not reads or len(reads) != before:
        before = len(reads)
        await asyncio.sleep(0.05)


@pytest.fixture
def reads(records, monkeypatch):
    """The ids of each read."""
    found, get_many = [], records.get_many
    monkeypatch.setattr(records, "get_many", lambda ids: (found.append(ids), get_many(ids))[1])
    return found


def test_all_that_wait_share_their_reads(watcher, records, reads):
    async def follow():
        waiting = start_waiting(watcher, WAITING)
        await settle(reads)
        assert len(reads) < 5
        updated = await asyncio.to_thread(records.update, "a", add_event)
        assert await asyncio.gather(*waiting) == [updated] * WAITING

    run_async(follow())
    assert len(reads) < 8


def test_many_jobs_are_one_query(watcher, records, reads):
    async def follow():
        waiting = [asyncio.create_task(watcher.wait_for_change(id_, 9)) for id_ in ("a", "b", "c")]
        found = await asyncio.gather(*waiting, return_exceptions=True)
        assert found[0] == NEW
        assert [type(error) for error in found[1:]] == [LookupError] * 2

    run_async(follow())
    assert reads == [["a", "b", "c"]]


def test_an_update_in_another_thread_is_noticed_at_once_in_one_event_loop_after_another(watcher, records, reads):
    records.update("a", lambda job: NEW)

    async def follow():
        (waiting,) = start_waiting(watcher)
        await settle(reads)
        updated = await asyncio.to_thread(records.update, "a", add_event)
        assert await waiting == updated

    for _ in range(2):
        records.update("a", lambda job: NEW)  # without an event loop, which is no error
        run_async(follow())


def test_a_redis_server_notifies_of_changes_by_other_processes(redis_server, tmp_path):
    queues = [Queue(tmp_path, redis_server.url) for _ in range(2)]
    queues[0].poll_seconds = (60.0, 60.0)
    here, elsewhere = (Records(queue.jobs) for queue in queues)
    elsewhere.update("a", create)
    watcher = Watcher(here, queues[0])
    server = redis.Redis.from_url(redis_server.url)

    async def follow(seen):
        waiting = asyncio.create_task(watcher.wait_for_change("a", seen))
        while not server.pubsub_channels():
            await asyncio.sleep(0.01)
        updated = await asyncio.to_thread(elsewhere.update, "a", add_event)
        assert await waiting == updated

    run_async(follow(1))
    redis_server.kill()
    redis_server.start()
    run_async(follow(2))
    for queue in queues:
        queue.close()
    server.close()


def test_nothing_is_read_when_nobody_waits_any_more(watcher, records, reads):
    async def follow():
        (waiting,) = start_waiting(watcher)
        await settle(reads)
        waiting.cancel()
        await asyncio.to_thread(records.update, "a", add_event)
        while watcher._reader is not None:  # it reads once more, on a busy machine later
            await asyncio.sleep(0.01)
        count = len(reads)
        await asyncio.to_thread(records.update, "a", add_event)
        await settle(reads)
        assert len(reads) == count

    run_async(follow())


def test_a_change_before_the_stop_is_returned_although_a_read_began_before_it(watcher, records, monkeypatch):
    get_many = records.get_many

    def change_meanwhile(ids):
        found = get_many(ids)
        monkeypatch.setattr(records, "get_many", get_many)
        records.update("a", add_event)
        asyncio.run_coroutine_threadsafe(stop(), watcher._loop).result()
        return found

    async def stop():
        watcher.stop()

    async def follow():
        monkeypatch.setattr(records, "get_many", change_meanwhile)
        (waiting,) = start_waiting(watcher)
        assert (await waiting).state == "running"

    run_async(follow())


def test_a_stopped_watcher_returns_what_changed_or_none(watcher, records, reads):
    async def follow():
        waiting = start_waiting(watcher, 3)
        await settle(reads)
        watcher.stop()
        assert await asyncio.gather(*waiting) == [None] * 3
        assert await watcher.wait_for_change("a", 1) is None
        assert await watcher.wait_for_change("a", 0) == NEW

    run_async(follow())


def test_an_error_of_the_queue_reaches_all_that_wait(watcher, records, monkeypatch):
    def fail(ids):
        raise QueueUnavailable("no queue")

    async def follow():
        monkeypatch.setattr(records, "get_many", fail)
        errors = await asyncio.gather(*start_waiting(watcher, 3), return_exceptions=True)
        assert [str(error) for error in errors] == ["no queue"] * 3

    run_async(follow())
