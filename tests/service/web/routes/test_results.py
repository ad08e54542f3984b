import asyncio
import io
import json
from types import SimpleNamespace

import pytest

from ciir.service.jobs.job import Event, Job, Problem, Request, Result
from ciir.service.web.routes import results

ID = "0123456789abcdef" * 2
QUEUED = Job(ID, Request("upload.glb", {"lenses": "5x5"}, None), created=1.5, events=(Event("queued"),))
PROGRESS = {"stage": "render", "views_done": 1, "views": 5}
RUNNING = QUEUED.after(Event("running"), state="running", attempts=1).after(Event("progress", PROGRESS))
DONE = RUNNING.after(Event("done"), state="done", result=Result("zip", 9, {"timings_ms": {"total": 1.0}}))
FAILED = RUNNING.after(Event("failed"), state="failed", problem=Problem(415, "Type not supported", "no mesh"))
CANCELLED = RUNNING.after(Event("cancelled"), state="cancelled")


@pytest.mark.parametrize(
    ("given", "tag"),
    [
        ([f'"{ID}"'], f'"{ID}"'),
        ([f'W/"{ID}"'], f'W/"{ID}"'),
        (['"x"', f'"y" ,  W/"{ID}"'], f'W/"{ID}"'),
        ([ID], None),
        ([f'"{ID[:-1]}"', "*", "", ","], None),
        ([], None),
    ],
)
def test_tags_that_name_a_result(given, tag):
    assert results.find_matching_tag(given, ID) == tag


@pytest.mark.parametrize("job", [QUEUED, RUNNING, DONE, FAILED, CANCELLED])
def test_a_status_holds_what_openapi_says(job):
    told = results.describe_job(job)
    assert json.loads(json.dumps(told)) == told
    assert set(results.STATUS_SCHEMA["required"]) <= set(told) <= set(results.STATUS_SCHEMA["properties"])
    assert told["state"] == job.state
    assert told["created"] == "1970-01-01T00:00:01.500+00:00"
    assert told["progress"] == (None if job is QUEUED else PROGRESS)
    assert ("result" in told, "report" in told) == (job is DONE, job is DONE)
    assert ("problem" in told) == (job is FAILED)


def test_progress_is_of_the_newest_run_and_whole_at_the_end():
    done = RUNNING.after(Event("done"), state="done", result=Result("zip", 9, {"views": [{}] * 5}))
    assert results.describe_job(done)["progress"] == {"stage": "encode", "views_done": 5, "views": 5}
    again = RUNNING.after(Event("queued"), state="queued")
    assert results.describe_job(again)["progress"] is None
    assert results.describe_job(again.after(Event("running"), state="running"))["progress"] is None


def test_what_a_status_says_at_the_end():
    assert results.describe_job(DONE)["result"] == {"url": f"{results.ROOT}/{ID}/result", "format": "zip", "size": 9}
    assert results.describe_job(DONE)["format"] == "zip"
    assert results.describe_job(FAILED)["problem"] == {
        "type": "urn:ciir:type-not-supported",
        "title": "Type not supported",
        "status": 415,
        "detail": "no mesh",
        "instance": f"{results.ROOT}/{ID}",
    }


@pytest.mark.parametrize(
    ("job", "status", "again"), [(QUEUED, 409, "1"), (RUNNING, 409, "1"), (CANCELLED, 409, None), (FAILED, 415, None)]
)
def test_a_result_that_is_not_there(job, status, again):
    answer = results.respond_unfinished(job, "/here")
    assert (answer.status_code, answer.headers.get("retry-after")) == (status, again)
    assert json.loads(answer.body)["instance"] == "/here"


def test_a_status_that_will_change_says_when_to_ask_again():
    assert results.respond_with_status(RUNNING).headers["retry-after"] == "1"
    assert "retry-after" not in results.respond_with_status(DONE).headers


def test_nothing_more_is_read_of_a_large_result_whose_head_is_asked_for(monkeypatch):
    monkeypatch.setattr(results, "CHUNK", 4)
    file = io.BytesIO(b"123456789")
    jobs = SimpleNamespace(open_result=lambda id_: file)
    answer = asyncio.run(results.respond_with_result(jobs, DONE, DONE.result, is_head=True))
    assert file.closed
    assert (answer.body, answer.headers["content-length"]) == (b"", "9")
    assert answer.headers["etag"] == f'W/"{ID}"'
