"""The routes of reconstructions: a form in, a job, its result out."""

import io
import json
import threading
import zipfile

import numpy as np
import pytest

import ciir
from ciir.errors import QueueFull, QueueUnavailable
from ciir.renderer.readers.pictures import decode
from ciir.service.jobs.job import Problem
from ciir.service.web.routes import results
from tests.support.inputs import BAD_INPUTS, EIA, contains_all
from tests.support.waiting import wait_until
from tests.support.web import check_problem, post_file, run_app

POST = "/v1/reconstructions"


def pause_work(client):
    """Makes jobs wait: (set when one has started, to be set to go on)."""
    started, go = threading.Event(), threading.Event()

    def before(work, progress, cancelled):
        started.set()
        assert go.wait(30)

    client.pool.before = before
    return started, go


@pytest.fixture
def own(tmp_path):
    """The client of a server that no other test uses."""
    with run_app(tmp_path) as client:
        yield client


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
        assert (again.status_code, again.content, again.headers["etag"].removeprefix("W/")) == (304, b"", tag)
        result = own.get(again.headers["content-location"], headers={"If-None-Match": given})
        assert (result.status_code, result.content, result.headers["etag"].removeprefix("W/")) == (304, b"", tag)
    assert post_file(own, headers={"If-None-Match": '"another"'}, **fields).status_code == 200
    assert own.pool.runs == 1
    with run_app(tmp_path / "another") as other:  # a server that has never run the job
        assert post_file(other, headers={"If-None-Match": tag}, **fields).status_code == 304
        assert other.pool.runs == 0


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


def test_only_refusals_that_follow_from_the_input_stand(own, eia):
    fields = {"data": eia, "lenses": "6x9", "model": "none"}
    for status, runs in ((503, 2), (422, 3)):
        own.pool.outcome = Problem(status, "Title", "a detail")
        for _ in range(2):
            response = post_file(own, **fields)
            check_problem(response, status, "a detail")
            assert response.headers.get("retry-after") == {503: "10"}.get(status)
        assert own.pool.runs == runs
    own.pool.outcome = None
    (id_,) = own.engine.jobs.queue.jobs.items()
    assert own.delete(f"{POST}/{id_}").json()["state"] == "failed"
    assert post_file(own, **fields).status_code == 200


def test_a_job_goes_on_without_its_client(own, eia):
    place = post_file(own, data=eia, headers={"Prefer": "wait=0"}, lenses="6x9", model="none").headers["location"]
    wait_until(lambda: own.get(place).json()["state"] == "done")
    assert own.pool.runs == 1
    assert post_file(own, data=eia, lenses="6x9", model="none").status_code == 200
    assert own.pool.runs == 1


@pytest.mark.parametrize("id_", ["0" * 32, "x", "0" * 33, "%2e%2e", "A" * 32])
def test_an_unknown_job(client, id_):
    for path in ("", "/result", "/events"):
        check_problem(client.get(f"{POST}/{id_}{path}"), 404, "post")
    check_problem(client.delete(f"{POST}/{id_}"), 404)


def test_an_expired_result(own, eia):
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


def test_only_the_suffix_of_a_file_name_is_used(client):
    detail = check_problem(post_file(client, "../../etc/pass\nwd.TXT", b"hello"), 415)
    assert "upload.txt" in detail
    assert "pass" not in detail


@pytest.mark.parametrize(
    ("kind", "taken", "others"), [("upscale", ".webp", (".glb", ".mp4")), ("elemental", ".glb", (".png", ".mp4"))]
)
def test_a_type_that_is_not_read_names_those_that_the_kind_takes(client, kind, taken, others):
    detail = check_problem(client.post(results.find_root(kind), files={"file": ("a.md", b"# hello")}), 415, taken)
    assert not any(other in detail for other in others)


def test_empty_fields_are_ignored(client, eia):
    assert post_file(client, data=eia, lenses="6x9", scale="", pitch=" ", format="").status_code == 200


@pytest.mark.parametrize("bad_input", BAD_INPUTS.values(), ids=BAD_INPUTS)
def test_bad_input(client, bad_input):
    name, data, texts, status, parts = bad_input
    for _ in range(2):
        runs = client.pool.runs
        detail = check_problem(post_file(client, name, data, **texts), status)
        assert contains_all(detail, parts), detail
    assert client.pool.runs == runs  # an input error is final


def test_a_shipped_scene_takes_the_place_of_the_file(own):
    fields = {"lenses": "8x6", "pixels": "3x3", "model": "none"}
    shown = {}
    for scene in ("vase", "globe"):
        done = own.post(POST, files={"scene": (None, scene)}, data=fields)
        shown[scene] = decode(done.content, name="x")
        status = own.get(f"{POST}/{done.headers['x-reconstruction-id']}").json()
        assert (status["input"], status["report"]["input"]["kind"]) == (f"scene:{scene}", "scene")
    for scene, picture in shown.items():
        expected = ciir.render(f"scene:{scene}", lenses=(8, 6), pixels=(3, 3)).view(1, 1)
        assert np.array_equal(picture, expected)
    assert own.post(POST, files={"scene": (None, "vase")}, data=fields).headers["server-timing"].startswith("stored")
    assert own.pool.runs == 2


def test_bad_forms(client, eia):
    problem, send = check_problem, post_file
    problem(send(client, data=eia, lens="6x9"), 422, "'lens'", "lenses")
    problem(send(client, data=eia, lenses="6x9", views="all", format="png"), 422, "16", "zip")
    problem(send(client, data=eia, lenses="6x9", format="bmp"), 422, "bmp", "npz")
    problem(client.post(POST, files={"other": ("a.png", eia)}), 422, "other")
    problem(client.post(POST, files={"lenses": (None, "6x9")}), 422, "file: missing")
    problem(client.post(POST, files={"scene": (None, "../vase")}), 422, "scene: no '../vase' here", "vase, globe")
    problem(client.post(POST, files={"scene": ("vase.png", eia)}), 422, "scene: a file")
    problem(send(client, data=eia, lenses="6x9", scene="vase"), 422, "beside a file")
    problem(client.post("/v1/upscales", files={"scene": (None, "vase")}), 422, "'scene': no such field")
    problem(client.post(POST, files={"file": (None, "text")}), 422, "plain field")
    problem(client.post(POST, files=[("lenses", (None, "6x9")), ("lenses", (None, "1x1"))]), 422, "twice")
    problem(client.post(POST, data={"lenses": "6x9"}), 415, "multipart/form-data")
    problem(client.post(POST, content=eia), 415, "the body has no type;")
    problem(client.post(POST, json={"file": "x"}), 415, "application/json")


def test_server_errors_are_problems_without_details(own, eia, monkeypatch, caplog):
    def broken(*_, **__):
        raise KeyError("secret")

    monkeypatch.setattr("ciir.service.pipeline.run.reconstruct", broken)
    assert "secret" not in check_problem(post_file(own, data=eia, lenses="6x9"), 500, "log")
    assert "secret" in caplog.text
    monkeypatch.undo()
    assert post_file(own, data=eia, lenses="6x9").status_code == 200  # the job runs again


def test_a_full_queue(own, eia, monkeypatch, caplog):
    def submit(*_, **__):
        raise QueueFull(7)

    monkeypatch.setattr(own.engine.jobs, "submit", submit)
    with caplog.at_level("INFO", "ciir.jobs"):
        response = post_file(own, data=eia, lenses="6x9")
    check_problem(response, 429, "again in 7 s")
    assert f"refused reconstruction of upload.png, {len(eia)} bytes: the queue is full" in caplog.text
    assert response.headers["retry-after"] == "7"


def test_without_a_queue(own, eia, monkeypatch):
    def fail(*_, **__):
        raise QueueUnavailable("the queue can't be reached; start it")

    for name in ("submit", "get", "count_waiting"):
        monkeypatch.setattr(own.engine.jobs, name, fail)
    for response in (post_file(own, data=eia, lenses="6x9"), own.get(f"{POST}/{'0' * 32}"), own.get("/readyz")):
        check_problem(response, 503, "start it")
        assert response.headers["retry-after"] == "1"
    assert "ciir_queue_up 0.0" in own.get("/metrics").text
    assert own.get("/healthz").status_code == 200


def test_limit_on_output_pixels(eia, tmp_path):
    with run_app(tmp_path, max_output_pixels=1000) as client:
        check_problem(post_file(client, data=eia, lenses="6x9", views="all"), 413, "16 views", "1,000")
