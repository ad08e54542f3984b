import json
from dataclasses import replace

import pytest

from ciir.service.jobs.job import CLIENTS_LIMIT, LONG_TEXT, Event, Job, Problem, Request, Result, parse_id

JOB = Job("0" * 32, Request("upload.png", {"lenses": "5x5"}, None), created=1.5, lane="large", input="i", lease="l")


@pytest.mark.parametrize(
    "job",
    [
        JOB,
        JOB.add_client("a").add_client("b"),
        JOB.add_event(Event("running", {"attempt": 1}), state="running").add_event(Event("progress", {"stage": "map"})),
        JOB.add_event(Event("failed"), state="failed", problem=Problem(422, "Not readable", "no file"), made_by="x"),
        JOB.add_event(Event("done"), state="done", result=Result("zip", 5, {"views": [{"v": 1}], "notes": ["ü"]})),
    ],
)
def test_bytes_are_parsed_to_the_same_job(job):
    assert Job.from_bytes(job.to_bytes()) == job
    assert Job.from_bytes(job.to_bytes()).to_bytes() == job.to_bytes()


def test_a_record_of_an_older_version_lists_no_clients():
    fields = json.loads(JOB.to_bytes())
    del fields["clients"]
    assert Job.from_bytes(json.dumps(fields).encode()) == JOB


def test_workers_of_versions_without_the_field_can_take_a_job():
    assert "made_by" not in json.loads(JOB.to_bytes())


def test_a_job_lists_each_client_once_and_not_too_many():
    assert JOB.add_client("a").add_client("b").add_client("a").clients == ("a", "b")
    job = JOB
    for number in range(2 * CLIENTS_LIMIT):
        job = job.add_client(str(number))
    assert len(job.clients) == CLIENTS_LIMIT


def test_a_long_option_is_stored_once():
    text = "#" * 2 * LONG_TEXT
    report = {"options": {"display": text, "camera": None, "views": "all"}, "notes": []}
    request = Request("upload.png", {"display": text, "views": "all"}, None)
    job = replace(JOB, request=request, state="done", result=Result("zip", 5, report))
    assert job.to_bytes().count(text.encode()) == 1
    assert Job.from_bytes(job.to_bytes()) == job
    assert report["options"]["display"] == text
    other = replace(job, result=Result("zip", 5, {"options": {"display": "other", "camera": None}}))
    assert Job.from_bytes(other.to_bytes()) == other


@pytest.mark.parametrize("text", [b"", b"{}", b"[]", b"\xff", b'{"problem": null, "result": null, "request": {}}'])
def test_other_bytes_are_refused(text):
    with pytest.raises((ValueError, LookupError, TypeError)):
        Job.from_bytes(text)


def test_attributes_that_a_newer_version_added_are_left_out():
    assert Job.from_bytes(json.dumps(json.loads(JOB.to_bytes()) | {"newer": 1}).encode()) == JOB


def test_no_two_runs_share_an_output():
    assert JOB.output == f"{'0' * 32}.l"
    assert parse_id(JOB.output) == JOB.id
    assert JOB.add_event(Event("running"), lease="m").output != JOB.output
