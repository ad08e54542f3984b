"""The routes of reconstructions: a form in, a job, its result out."""

import io
import json
import shutil
import threading
import time
import zipfile

import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from ciir.service.web.routes import results
from tests.support.inputs import EIA
from tests.support.jobs import set_clock
from tests.support.waiting import wait_until
from tests.support.web import POST, check_problem, post_file, run_app


def pause_work(client):
    """Makes jobs wait: (set when one has started, to be set to go on)."""
    started, go = threading.Event(), threading.Event()

    def before(work, progress, cancelled):
        started.set()
        assert go.wait(30)

    client.pool.before = before
    return started, go


def parse_events(response):
    """(number, kind, data) of each event of a stream."""
    found = []
    for block in response.text.split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.splitlines() if not line.startswith(":"))
        if "event" in fields:
            found.append((int(fields["id"]), fields["event"], json.loads(fields["data"])))
    return found


def test_one_view_is_a_png(client, eia):
    response = post_file(client, data=eia, lenses="6x9", views="1,2", model="none")
    assert response.status_code == 200
    assert response.headers["content-type"] == "image/png"
    assert np.array_equal(decode(response.content, name="x"), EIA[1::4, 2::4])
    stages = [part.split(";dur=") for part in response.headers["server-timing"].split(", ")]
    assert [stage for stage, _ in stages] == ["decode", "plan", "map", "encode", "total"]
    assert all(float(ms) >= 0 for _, ms in stages)


def test_several_views_are_a_zip_with_a_report(client, eia):
    response = post_file(client, data=eia, lenses="6x9", views="cross", model="bicubic")
    assert response.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(response.content)) as archive:
        report = json.loads(archive.read("report.json"))
        assert set(archive.namelist()) == {"report.json", *(view["file"] for view in report["views"])}
    assert report["input"]["name"] == "upload.png"
    assert report["lens_array"]["rows"] == 6
    timings = [f"{stage};dur={ms:.3f}" for stage, ms in report["timings_ms"].items()]
    assert response.headers["server-timing"] == ", ".join(timings)


def test_npz(client, eia):
    response = post_file(client, data=eia, lenses="6x9", views="all", model="none", format="npz")
    with np.load(io.BytesIO(response.content), allow_pickle=False) as arrays:
        assert arrays["views"].shape == (16, 6, 9, 3)
        assert arrays["positions"][7].tolist() == [1, 3]
        assert json.loads(str(arrays["report"]))["plan"]["model"] == "none"


def test_a_large_result_goes_out_in_pieces(client, eia, monkeypatch):
    fields = {"lenses": "6x9", "views": "all", "model": "none", "format": "npz"}
    whole = post_file(client, data=eia, **fields)
    monkeypatch.setattr(results, "CHUNK", 37)
    pieces = post_file(client, data=eia, **fields)
    assert pieces.content == whole.content
    assert pieces.headers["content-length"] == whole.headers["content-length"] == str(len(whole.content))


def test_a_repeated_request_runs_no_job(own, eia):
    fields = {"lenses": "6x9", "views": "cross", "model": "bicubic"}
    first, again = (post_file(own, data=eia, **fields) for _ in range(2))
    assert own.pool.runs == 1
    assert again.content == first.content
    for header in ("x-reconstruction-id", "etag", "content-type", "content-location"):
        assert first.headers[header] == again.headers[header]
    assert "stored;dur=" in again.headers["server-timing"]
    assert "stored" not in first.headers["server-timing"]
    assert post_file(own, data=eia, **fields | {"model": "nearest"}).status_code == 200
    assert own.pool.runs == 2


def test_two_equal_requests_share_a_job(own, eia):
    started, go = pause_work(own)
    responses = []
    threads = [
        threading.Thread(target=lambda: responses.append(post_file(own, data=eia, lenses="6x9", model="none")))
        for _ in range(2)
    ]
    threads[0].start()
    assert started.wait(30)
    threads[1].start()
    wait_until(lambda: own.engine.metrics.submitted.labels("known")._value.get() == 1)
    go.set()
    for thread in threads:
        thread.join(30)
    assert [response.status_code for response in responses] == [200, 200]
    assert responses[0].content == responses[1].content
    assert own.pool.runs == 1


def test_if_none_match(own, eia, tmp_path):
    fields = {"data": eia, "lenses": "6x9", "model": "none"}
    tag = post_file(own, **fields).headers["etag"]
    for given in (tag, f'"x", W/{tag}'):
        again = post_file(own, headers={"If-None-Match": given}, **fields)
        assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
        place = again.headers["content-location"]
        result = own.get(place, headers={"If-None-Match": given})
        assert (result.status_code, result.content, result.headers["etag"]) == (304, b"", tag)
    for given in ('"another"', "*"):  # `*` stands for any result, which only a request for the result can have
        assert post_file(own, headers={"If-None-Match": given}, **fields).status_code == 200
    assert own.get(place, headers={"If-None-Match": "*"}).status_code == 304
    assert own.pool.runs == 1
    with run_app(tmp_path / "another") as other:  # a server that has never run the job
        assert post_file(other, headers={"If-None-Match": tag}, **fields).status_code == 304
        assert other.pool.runs == 1
        shutil.rmtree(tmp_path / "another/files/results")
        for given in (tag, "*"):
            assert other.get(place, headers={"If-None-Match": given}).status_code == 410


def test_a_job_that_is_not_done_is_not_unchanged(own, eia):
    started, go = pause_work(own)
    fields = {"data": eia, "lenses": "6x9", "model": "none"}
    id_ = post_file(own, headers={"Prefer": "respond-async"}, **fields).headers["x-reconstruction-id"]
    assert started.wait(30)
    early = post_file(own, headers={"If-None-Match": f'"{id_}"', "Prefer": "wait=0"}, **fields)
    assert early.status_code == 202
    go.set()


@pytest.mark.parametrize("form", ["zip", "npz"])
def test_a_download_is_continued(own, eia, form):
    whole = post_file(own, data=eia, lenses="6x9", views="cross", model="none", format=form)
    tag, place = whole.headers["etag"], whole.headers["content-location"]
    rest = own.get(place, headers={"Range": "bytes=100-", "If-Range": tag})
    assert (rest.status_code, rest.headers["etag"]) == (206, tag)
    assert whole.content[:100] + rest.content == whole.content
    assert own.delete(place.removesuffix("/result")).status_code == 200
    again = post_file(own, data=eia, lenses="6x9", views="cross", model="none", format=form)
    assert (again.headers["etag"] == tag) == (again.content == whole.content)
    other = own.get(place, headers={"Range": "bytes=100-", "If-Range": '"other"'})
    assert (other.status_code, other.content) == (200, again.content)


def test_respond_async(own, eia):
    started, go = pause_work(own)
    response = post_file(own, data=eia, headers={"Prefer": "respond-async"}, lenses="6x9", views="1,2", model="none")
    assert response.status_code == 202
    assert response.headers["preference-applied"] == "respond-async"
    assert response.headers["retry-after"] == "1"
    place = response.headers["location"]
    assert place == f"{POST}/{response.headers['x-reconstruction-id']}"
    assert response.json()["state"] in ("queued", "running")
    assert started.wait(30)
    status = own.get(place)
    assert (status.json()["state"], status.json()["attempts"]) == ("running", 1)
    assert status.headers["cache-control"] == "no-store"
    assert "result" not in status.json()
    early = own.get(f"{place}/result")
    check_problem(early, 409, "running", "/events")
    assert early.headers["retry-after"] == "1"
    go.set()
    wait_until(lambda: own.get(place).json()["state"] == "done")
    status = own.get(place).json()
    assert status["options"] == {"lenses": "6x9", "views": "1,2", "model": "none"}
    assert (status["format"], status["input"]) == ("png", "upload.png")
    assert status["report"]["plan"]["model"] == "none"
    result = own.get(status["result"]["url"])
    assert np.array_equal(decode(result.content, name="x"), EIA[1::4, 2::4])
    assert len(result.content) == status["result"]["size"]
    assert own.head(status["result"]["url"]).headers["etag"] == result.headers["etag"]


def test_wait(own, eia):
    started, go = pause_work(own)
    response = post_file(own, data=eia, headers={"Prefer": "wait=0"}, lenses="6x9", model="none")
    assert (response.status_code, response.headers["preference-applied"]) == (202, "wait=0")
    assert started.wait(30)
    go.set()
    response = post_file(own, data=eia, headers={"Prefer": "respond-async, wait=10"}, lenses="6x9", model="none")
    assert (response.status_code, response.headers["preference-applied"]) == (200, "respond-async, wait=10")


def test_a_job_that_takes_longer_than_sync_seconds(eia, tmp_path):
    with run_app(tmp_path, sync_seconds=0) as client:
        started, go = pause_work(client)
        response = post_file(client, data=eia, lenses="6x9", model="none")
        assert response.status_code == 202
        assert "preference-applied" not in response.headers
        assert started.wait(30)
        go.set()


def test_events_can_be_read_again(own, eia):
    started, go = pause_work(own)
    place = post_file(
        own, data=eia, headers={"Prefer": "respond-async"}, lenses="6x9", views="all", model="none"
    ).headers["location"]
    assert started.wait(30)
    streams = []
    reader = threading.Thread(target=lambda: streams.append(own.get(f"{place}/events")))
    reader.start()
    go.set()
    reader.join(30)
    stream = streams[0]
    assert stream.headers["content-type"].startswith("text/event-stream")
    live = parse_events(stream)
    assert [number for number, _, _ in live] == list(range(len(live)))
    assert [kind for _, kind, _ in live][:2] == ["queued", "running"]
    assert live[-1][1] == "done"
    assert parse_events(own.get(f"{place}/events")) == live
    assert parse_events(own.get(f"{place}/events", headers={"Last-Event-ID": "0"})) == live[1:]
    end = own.get(f"{place}/events", headers={"Last-Event-ID": str(live[-1][0])})
    assert (end.status_code, end.content) == (204, b"")
    check_problem(own.get(f"{place}/events", headers={"Last-Event-ID": "x"}), 400, "'x'", "leave it out")


def test_cancelling(own, eia):
    started, go = pause_work(own)
    place = post_file(own, data=eia, headers={"Prefer": "respond-async"}, lenses="6x9", model="none").headers[
        "location"
    ]
    assert started.wait(30)
    assert own.delete(place).json()["state"] == "cancelled"
    go.set()
    check_problem(own.get(f"{place}/result"), 409, "cancelled", "again")
    assert parse_events(own.get(f"{place}/events"))[-1][1] == "cancelled"
    assert post_file(own, data=eia, lenses="6x9", model="none").status_code == 200
    assert own.delete(place).json()["state"] == "done"  # a job that has ended is removed
    check_problem(own.get(place), 404)
    check_problem(own.delete(place), 404)


def test_cancelling_one_of_two_equal_requests(tmp_path, eia):
    first, second = ({"X-API-Key": key, "Prefer": "respond-async"} for key in ("first", "second"))
    with run_app(tmp_path, api_keys="first,second") as own:
        started, go = pause_work(own)
        place = post_file(own, data=eia, headers=first, lenses="6x9", model="none").headers["location"]
        assert started.wait(30)
        assert post_file(own, data=eia, headers=second, lenses="6x9", model="none").headers["location"] == place
        response = own.delete(place, headers=first)
        assert (response.status_code, response.json()["state"]) == (200, "running")
        job = own.engine.jobs.get(place.rpartition("/")[2])
        assert [len(client) for client in job.clients] == [16]
        assert "clients" not in response.json()
        go.set()
        wait_until(lambda: own.get(place, headers=second).json()["state"] == "done")
        assert own.get(f"{place}/result", headers=second).status_code == 200
        assert own.delete(place, headers=first).json()["state"] == "done"  # a client that never asked removes nothing
        assert own.get(f"{place}/result", headers=second).status_code == 200
        assert own.delete(place, headers=second).json()["state"] == "done"
        check_problem(own.get(place, headers=second), 404)


def test_a_job_goes_on_without_its_client(own, eia):
    place = post_file(own, data=eia, headers={"Prefer": "wait=0"}, lenses="6x9", model="none").headers["location"]
    wait_until(lambda: own.get(place).json()["state"] == "done")
    assert own.pool.runs == 1
    assert post_file(own, data=eia, lenses="6x9", model="none").status_code == 200
    assert own.pool.runs == 1


def test_an_expired_job(own, eia, monkeypatch):
    place = post_file(own, data=eia, lenses="6x9", model="none").headers["content-location"]
    set_clock(monkeypatch, time.time() + 86_401)
    own.engine.jobs.sweep()
    for path in ("", "/result", "/events"):
        check_problem(own.get(place.removesuffix("/result") + path), 404, "has expired; post its file again")


def test_a_missing_result(own, eia):
    fields = {"data": eia, "lenses": "6x9", "model": "none"}
    place = post_file(own, **fields).headers["content-location"]
    job = own.engine.jobs.get(place.split("/")[-2])
    own.engine.jobs.files.remove("results", job.output)
    check_problem(own.get(place), 410, "again")
    assert post_file(own, **fields).status_code == 200
    assert own.get(place).status_code == 200


@pytest.mark.parametrize("position", [None, 0, -20])
def test_a_damaged_result_is_never_sent(own, eia, position):
    fields = {"data": eia, "lenses": "6x9", "model": "none"}
    first = post_file(own, **fields)
    place = first.headers["content-location"]

    def damage():
        job = own.engine.jobs.get(place.split("/")[-2])
        data = bytearray(first.content) if position is not None else b""
        if position is not None:
            data[position] ^= 1
        (own.engine.jobs.folder / "files" / "results" / job.output).write_bytes(data)

    damage()
    assert own.get(place.removesuffix("/result")).json()["result"]["url"] == place
    check_problem(own.get(place), 410, "post the input again")
    status = own.get(place.removesuffix("/result")).json()
    assert (status["state"], "result" in status, status["problem"]["status"]) == ("done", False, 410)
    for _ in range(2):
        again = post_file(own, **fields)
        assert (again.status_code, again.content) == (200, first.content)
        assert own.get(place).content == first.content
        damage()
