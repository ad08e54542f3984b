import asyncio
import io
import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from ciir.service.jobs import identity
from ciir.service.jobs.job import Event, Job, Problem, Request, Result
from ciir.service.web.routes import results
from ciir.service.web.routes.document import make_schemas

ID = "0123456789abcdef" * 2
QUEUED = Job(ID, Request("upload.glb", {"lenses": "5x5"}, None), created=1.5, events=(Event("queued"),))
PROGRESS = {"stage": "render", "views_done": 1, "views": 5}
RUNNING = QUEUED.add_event(Event("running"), state="running", attempts=1).add_event(Event("progress", PROGRESS))
REPORT = {"timings_ms": {"total": 1.0}, "notes": ["a note on ΔE"]}
DONE = RUNNING.add_event(
    Event("done"), state="done", result=Result("zip", 9, REPORT, "5" * 64), made_by=identity.hash_installation()
)
TAG = f'"{ID}-{"5" * 32}"'
FAILED = RUNNING.add_event(Event("failed"), state="failed", problem=Problem(415, "Type not supported", "no mesh"))
CANCELLED = RUNNING.add_event(Event("cancelled"), state="cancelled")


@pytest.mark.parametrize(
    ("given", "is_listed"),
    [
        ([TAG], True),
        ([f"W/{TAG}"], True),
        (['"x"', f'"y" ,  W/{TAG}'], True),
        ([TAG.strip('"')], False),
        ([f'"{ID}"', f'W/"{ID}"', "*", "", ","], False),
        ([], False),
    ],
)
def test_tags_that_a_client_has(given, is_listed):
    assert results.has_tag(given, results.make_tag(DONE, DONE.result)) == is_listed


@pytest.mark.parametrize("job", [QUEUED, RUNNING, DONE, FAILED, CANCELLED])
def test_a_status_agrees_with_openapi(job):
    status = results.describe_job(job)
    assert json.loads(json.dumps(status)) == status
    schema = make_schemas()["Reconstruction"]
    assert set(schema["required"]) <= set(status) <= set(schema["properties"])
    assert status["state"] == job.state
    assert status["created"] == "1970-01-01T00:00:01.500+00:00"
    assert status["progress"] == (None if job is QUEUED else PROGRESS)
    assert ("result" in status, "report" in status) == (job is DONE, job is DONE)
    assert ("problem" in status) == (job is FAILED)


def test_progress_is_that_of_the_current_run():
    done = RUNNING.add_event(Event("done"), state="done", result=Result("zip", 9, {}, views=5))
    assert results.describe_job(done)["progress"] == {"stage": "encode", "views_done": 5, "views": 5}
    again = RUNNING.add_event(Event("queued"), state="queued")
    assert results.describe_job(again)["progress"] is None
    assert results.describe_job(again.add_event(Event("running"), state="running"))["progress"] is None


@pytest.mark.parametrize(
    ("job", "status", "again"), [(QUEUED, 409, "1"), (RUNNING, 409, "1"), (CANCELLED, 409, None), (FAILED, 415, None)]
)
def test_a_missing_result(job, status, again):
    response = results.respond_unfinished(job, "/here", is_post=False)
    assert (response.status_code, response.headers.get("retry-after")) == (status, again)
    assert json.loads(response.body)["instance"] == "/here"


def test_only_a_post_is_repeated_after_an_error_of_the_server():
    job = RUNNING.add_event(Event("failed"), state="failed", problem=Problem(503, "Not available", "post it again"))
    again = [results.respond_unfinished(job, "/", is_post=post).headers.get("retry-after") for post in (True, False)]
    assert again == ["10", None]


def read(jobs, job, result, method="GET", **headers):
    request = SimpleNamespace(method=method, headers=headers, url=SimpleNamespace(path="/result"))
    return asyncio.run(results.respond_to_read(jobs, job, result, request))


def test_head_of_a_large_result_reads_one_chunk(monkeypatch):
    monkeypatch.setattr(results, "CHUNK", 4)
    file = io.BytesIO(b"123456789")
    jobs = SimpleNamespace(open_result=lambda id_: file)
    response = read(jobs, DONE, DONE.result, method="HEAD", range="bytes=2-")
    assert file.closed
    assert (response.body, response.headers["content-length"]) == (b"", "9")
    assert response.headers["etag"] == TAG
    assert response.headers["x-notes"] == r'["a note on \u0394E"]'


@pytest.mark.parametrize("chunk", [2, 100])
def test_a_part_of_a_result(monkeypatch, chunk):
    monkeypatch.setattr(results, "CHUNK", chunk)
    file = io.BytesIO(b"123456789")
    response = read(SimpleNamespace(open_result=lambda id_: file), DONE, DONE.result, range="bytes=3-7")

    async def collect():
        return b"".join([part async for part in response.body_iterator]) if chunk == 2 else response.body

    assert asyncio.run(collect()) == b"45678"
    assert response.status_code == 206
    assert response.headers["content-range"] == "bytes 3-7/9"
    assert response.headers["content-length"] == "5"
    assert response.headers["accept-ranges"] == "bytes"
    assert file.closed


def test_a_part_beyond_the_end_is_a_problem():
    response = read(SimpleNamespace(), DONE, DONE.result, range="bytes=9-")
    assert (response.status_code, response.headers["content-range"]) == (416, "bytes */9")
    problem = json.loads(response.body)
    assert problem["detail"] == "Range: 'bytes=9-' asks for no byte of the 9; leave it out"


def test_other_bytes_have_another_tag():
    other = replace(DONE.result, sha256="6" * 64)
    assert results.make_tag(DONE, other) != TAG
    part = read(SimpleNamespace(), DONE, DONE.result, **{"range": "bytes=9-", "if-range": TAG})
    assert part.status_code == 416
    jobs = SimpleNamespace(open_result=lambda id_: io.BytesIO(b"123456789"))
    whole = read(jobs, DONE, other, **{"range": "bytes=9-", "if-range": TAG})
    assert (whole.status_code, whole.body) == (200, b"123456789")


@pytest.mark.parametrize("count", [0, 3, 100])
def test_notes_in_the_header_have_a_limit(count):
    notes = [f"{number}{'x' * 200}" for number in range(count)]
    report = {"timings_ms": {}, "notes": notes}
    jobs = SimpleNamespace(open_result=lambda id_: io.BytesIO(b""))
    response = asyncio.run(results.respond_with_result(jobs, DONE, Result("zip", 0, report)))
    found = json.loads(response.headers["x-notes"])
    assert len(response.headers["x-notes"]) <= results.MOST_NOTES
    if count < 100:
        assert found == notes
    else:
        assert found[:-1] == notes[: len(found) - 1]
        assert found[-1] == f"{100 - len(found) + 1} more in the report of /v1/reconstructions/{ID}"
