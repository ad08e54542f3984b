import json
import logging

from ciir.service.jobs.job import LONG_TEXT, Event, Job, Request
from ciir.service.jobs.records import Records

NEW = Job("a", Request("upload.png", {}, None), events=(Event("queued"),))


def create(job):
    return NEW if job is None else None


def add_event(job):
    return job.add_event(Event("running"), state="running")


def test_records_are_created_updated_and_removed(queue):
    records = Records(queue.jobs)
    assert records.get("a") is None
    assert records.update("a", create) == NEW
    assert records.update("a", create) is None
    updated = records.update("a", add_event)
    assert records.get_many(["a", "b"]) == {"a": updated}
    assert records.remove("a", lambda job: job.state == "queued") is None
    assert records.remove("a", lambda job: job.state == "running") == updated
    assert records.get("a") is None
    assert records.remove("a", lambda job: True) is None


def test_subscribers_are_notified_of_updates(queue):
    records, notified = Records(queue.jobs), []
    records.subscribe(notified.append)
    records.update("a", create)
    records.update("a", create)  # changes nothing
    records.update("a", add_event)
    assert notified == ["a", "a"]


def test_a_record_of_another_version_is_logged_and_ignored(queue, caplog):
    records = Records(queue.jobs)
    queue.jobs.put("a", b'{"id": "a"}')
    with caplog.at_level(logging.WARNING):
        assert records.get("a") is None
        assert records.remove("a", lambda job: True) is None
        assert queue.jobs.get("a") is None
    assert "job a" in caplog.text
    queue.jobs.put("a", b"{}")
    assert records.update("a", create) == NEW
    damaged = json.loads(NEW.to_bytes()) | {"result": {"format": "png", "size": 1, "report": None}}
    damaged["request"]["options"] = {"display": LONG_TEXT * "x" + "x"}
    queue.jobs.put("a", json.dumps(damaged).encode())
    assert records.get("a") is None
