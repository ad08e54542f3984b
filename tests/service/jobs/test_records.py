import asyncio
import logging
import threading

from ciir.service.jobs.job import Event, Job, Request
from ciir.service.jobs.records import Records

NEW = Job("a", Request("upload.png", {}, None), events=(Event("queued"),))


def test_made_changed_and_removed(queue):
    records = Records(queue.jobs)
    assert records.get("a") is None
    assert records.change("a", lambda job: NEW if job is None else None) == NEW
    assert records.change("a", lambda job: NEW if job is None else None) is None
    changed = records.change("a", lambda job: job.after(Event("running"), state="running"))
    assert records.many(["a", "b"]) == {"a": changed}
    assert records.remove("a", lambda job: job.state == "queued") is None
    assert records.remove("a", lambda job: job.state == "running") == changed
    assert records.get("a") is None
    assert records.remove("a", lambda job: True) is None


def test_of_many_changes_at_once_none_is_lost(queue):
    records = Records(queue.jobs)
    records.change("a", lambda _: NEW)

    def add():
        for _ in range(15):
            records.change("a", lambda job: job.after(Event("progress")))

    threads = [threading.Thread(target=add) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(records.get("a").events) == 61


def test_listeners_hear_of_changes_in_other_threads(queue):
    records = Records(queue.jobs)
    records.change("a", lambda _: NEW)

    async def listen():
        with records.listening("a") as one, records.listening("a") as other:
            assert await one.heard(0.01) is None
            change = asyncio.to_thread(records.change, "a", lambda job: job.after(Event("running")))
            changed = await change
            assert await one.heard(30) == changed
            assert await other.heard(30) == changed
            assert await one.heard(0.01) is None
        assert not records._listeners

    asyncio.run(listen())


def test_a_listener_whose_loop_has_ended_harms_nobody(queue):
    records = Records(queue.jobs)

    async def listen():
        return records.listening("a").__enter__()

    asyncio.run(listen())
    assert records.change("a", lambda _: NEW) == NEW


def test_a_record_of_another_version_is_told_and_counts_as_not_there(queue, caplog):
    records = Records(queue.jobs)
    queue.jobs.put("a", b'{"id": "a"}')
    with caplog.at_level(logging.WARNING):
        assert records.get("a") is None
        assert records.remove("a", lambda job: True) is None
        assert queue.jobs.get("a") is None
    assert "job a" in caplog.text
    queue.jobs.put("a", b"{}")
    assert records.change("a", lambda job: NEW if job is None else None) == NEW
