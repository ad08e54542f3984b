"""Routes and errors in-process; what needs a real connection is in test_server.py."""

import io
import json
import time
import zipfile

import numpy as np
import pytest
from fastapi.testclient import TestClient
from starlette.requests import ClientDisconnect

from models import catalogue
from models.errors import BadCard
from renderer.errors import InvalidOption, TooLarge
from renderer.pictures import decode
from service import answers, multipart, settings, turns
from service import app as app_module
from service.app import create_app
from service.outputs import FORMATS, FileSink
from service.request import NAMES, Options
from service.settings import Settings
from service.upload import Upload

ROUTES = [
    ("POST", "/v1/reconstructions"),
    ("GET", "/v1/models"),
    ("GET", "/healthz"),
    ("GET", "/readyz"),
    ("GET", "/docs"),
    ("GET", "/openapi.json"),
]
POST = "/v1/reconstructions"


def wait_until_ready(client):
    until(lambda: client.get("/readyz").status_code == 200)
    return client


def until(holds, seconds=30):
    """Asks again and again, but not for ever."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, f"still not so after {seconds} s"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def client():
    with TestClient(create_app(Settings(store_bytes=0)), raise_server_exceptions=False) as client:
        yield wait_until_ready(client)


def problem(response, status, *words):
    """Checks the one shape of errors; returns `detail`."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    body = response.json()
    assert set(body) == {"type", "title", "status", "detail", "instance"}
    assert body["status"] == status
    assert body["instance"] == response.request.url.path
    assert body["type"] == "about:blank" or body["type"].startswith("urn:ciir:")
    assert body["title"]
    assert "\n" not in body["detail"]
    for word in words:
        assert word in body["detail"]
    return body["detail"]


def send(client, name="eia.png", data=b"", **fields):
    return client.post(POST, files={"file": (name, data)}, data=fields)


@pytest.fixture
def eia(samples):
    return samples.encode_png(samples.EIA)


def test_one_view_is_a_png(client, samples, eia):
    response = send(client, data=eia, lenses="6x9", views="1,2", model="none")
    assert response.status_code == 200
    assert response.headers["content-type"] == "image/png"
    assert np.array_equal(decode(response.content, name="x"), samples.EIA[1::4, 2::4])
    stages = [part.split(";dur=") for part in response.headers["server-timing"].split(", ")]
    assert [stage for stage, _ in stages] == ["decode", "plan", "map", "encode", "total"]
    assert all(float(ms) >= 0 for _, ms in stages)


def test_several_views_are_a_zip_with_a_report(client, samples, eia):
    response = send(client, data=eia, lenses="6x9", views="cross", model="bicubic")
    assert response.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(response.content)) as archive:
        report = json.loads(archive.read("report.json"))
        assert set(archive.namelist()) == {"report.json", *(view["file"] for view in report["views"])}
    assert report["input"]["name"] == "upload.png"
    assert report["lens_array"]["rows"] == 6
    timings = [f"{stage};dur={ms:.3f}" for stage, ms in report["timings_ms"].items()]
    assert response.headers["server-timing"] == ", ".join(timings)


def test_npz(client, samples, eia):
    response = send(client, data=eia, lenses="6x9", views="all", model="none", format="npz")
    with np.load(io.BytesIO(response.content), allow_pickle=False) as arrays:
        assert arrays["views"].shape == (16, 6, 9, 3)
        assert arrays["positions"][7].tolist() == [1, 3]
        assert json.loads(str(arrays["report"]))["plan"]["model"] == "none"


def test_a_mesh(client, samples):
    fields = {"lenses": "12x10", "pixels": "3x5", "backend": "raytrace", "model": "bicubic"}
    response = send(client, "cube.off", samples.CUBE, **fields)
    assert decode(response.content, name="x").shape == (24, 20, 3)


def test_a_large_answer_goes_through_a_file(client, samples, eia, monkeypatch):
    whole = send(client, data=eia, lenses="6x9", views="all", model="none", format="npz")
    monkeypatch.setattr(answers, "MEMORY_BYTES", 100)
    monkeypatch.setattr(app_module, "CHUNK", 37)
    spooled = send(client, data=eia, lenses="6x9", views="all", model="none", format="npz")
    with np.load(io.BytesIO(whole.content)) as a, np.load(io.BytesIO(spooled.content)) as b:
        assert np.array_equal(a["views"], b["views"])


def test_the_id_follows_what_the_result_depends_on(client, samples, eia):
    def ids(**fields):
        response = send(client, **({"data": eia, "lenses": "6x9", "model": "none"} | fields))
        assert response.status_code == 200, response.text
        return response.headers["x-reconstruction-id"], response.headers["etag"]

    one, tag = ids()
    assert tag == f'"{one}"'
    assert ids() == (one, tag)
    assert ids(name="other name.png") == (one, tag)
    assert ids(format="zip") == (one, f'W/"{one}-zip"')
    others = [ids(views="0,0"), ids(model="bicubic"), ids(data=samples.encode_png(samples.EIA[::-1]))]
    assert len({one, *(other for other, _ in others)}) == 4


def test_client_file_names_give_a_suffix_and_no_more(client, samples):
    detail = problem(send(client, "../../etc/pass\nwd.TXT", b"hello"), 415)
    assert "upload.txt" in detail
    assert "pass" not in detail


def test_fields_that_a_web_form_left_empty_are_not_given(client, eia):
    assert send(client, data=eia, lenses="6x9", scale="", pitch=" ", format="").status_code == 200


def test_bad_input(client, samples, bad_input):
    name, data, texts, status, words = bad_input
    detail = problem(send(client, name, data, **texts), status)
    assert samples.holds(detail, words), detail


def test_bad_forms(client, eia):
    problem(send(client, data=eia, lens="6x9"), 422, "'lens'", "lenses")
    problem(send(client, data=eia, lenses="6x9", views="all", format="png"), 422, "16", "zip")
    problem(send(client, data=eia, lenses="6x9", format="gif"), 422, "gif", "npz")
    problem(client.post(POST, files={"other": ("a.png", eia)}), 422, "other")
    problem(client.post(POST, files={"lenses": (None, "6x9")}), 422, "file: missing")
    problem(client.post(POST, files={"file": (None, "text")}), 422, "plain field")
    problem(client.post(POST, files=[("lenses", (None, "6x9")), ("lenses", (None, "1x1"))]), 422, "twice")
    problem(client.post(POST, files=[("file", ("a.png", eia)), ("file", ("b.png", eia))]), 400, "1", "; send one")
    problem(client.post(POST, data={"lenses": "6x9"}), 415, "multipart/form-data")
    problem(client.post(POST, content=eia), 415, "nothing")
    problem(client.post(POST, json={"file": "x"}), 415, "application/json")
    problem(client.post(POST, content=b"x", headers={"content-type": "multipart/form-data"}), 400, "boundary")
    broken = {"content-type": "multipart/form-data; boundary=b"}
    problem(client.post(POST, content=b"--b\r\nnonsense", headers=broken), 400, "closing boundary; send")
    long_field = {"file": ("a.png", eia), "views": (None, "0,0;" * multipart.MAX_FIELD_BYTES)}
    problem(client.post(POST, files=long_field), 400, "Part")


@pytest.mark.parametrize(("method", "path"), ROUTES)
def test_another_method_is_a_problem(client, method, path):
    other = "GET" if method == "POST" else "POST"
    response = client.request(other, path)
    problem(response, 405, "method")
    assert method in response.headers["allow"]


@pytest.mark.parametrize("path", ["/", "/v1", "/v1/nothing", "/docs/static/gone.js", "/docs/static/../app.py"])
def test_nothing_there_is_a_problem(client, path):
    problem(client.get(path), 404, "/docs")


def test_faults_of_the_server_are_problems_without_details(client, eia, monkeypatch):
    def broken(*_, **__):
        raise KeyError("secret")

    monkeypatch.setattr("service.pipeline.reconstruct", broken)
    assert "secret" not in problem(send(client, data=eia, lenses="6x9"), 500, "log")

    def bad_card():
        raise BadCard("/secret/path: broken")

    monkeypatch.setattr("models.catalogue.entries", bad_card)
    assert "secret" not in problem(client.get("/v1/models"), 500, "log")


def test_a_result_asked_for_twice_is_made_once(samples, eia, monkeypatch, tmp_path):
    runs = []
    whole = answers.pipeline.reconstruct
    monkeypatch.setattr(answers.pipeline, "reconstruct", lambda *a, **b: runs.append(a) or whole(*a, **b))
    with TestClient(create_app(Settings(store=str(tmp_path)))) as client:
        wait_until_ready(client)
        first, again = (send(client, data=eia, lenses="6x9", views="cross", model="bicubic") for _ in range(2))
        send(client, data=eia, lenses="6x9", views="cross", model="nearest")
        png, stored = (send(client, data=eia, lenses="6x9", model="bicubic") for _ in range(2))
    assert len(runs) == 3
    for header in ("x-reconstruction-id", "etag", "content-type", "content-disposition"):
        assert first.headers[header] == again.headers[header]
    assert "stored;dur=" in again.headers["server-timing"]
    assert "stored" not in first.headers["server-timing"]
    with zipfile.ZipFile(io.BytesIO(first.content)) as a, zipfile.ZipFile(io.BytesIO(again.content)) as b:
        reports = [json.loads(archive.read("report.json")) for archive in (a, b)]
        assert a.namelist() == b.namelist()
    assert {**reports[0], "timings_ms": 0} == {**reports[1], "timings_ms": 0}
    assert png.content == stored.content


def test_a_store_that_fails_is_no_matter_to_the_client(eia, tmp_path, caplog):
    (tmp_path / "file").write_bytes(b"no folder")
    with TestClient(create_app(Settings(store=str(tmp_path / "file")))) as client:
        wait_until_ready(client)
        assert send(client, data=eia, lenses="6x9", model="none").status_code == 200
    assert str(tmp_path / "file") in caplog.text


def test_results_are_stored_in_the_cache_folder_unless_told_otherwise(monkeypatch, tmp_path):
    monkeypatch.setenv("CIIR_CACHE", str(tmp_path))
    assert Settings().open_store()._folder == tmp_path / "results"
    monkeypatch.setenv("CIIR_STORE", str(tmp_path / "mine"))
    assert Settings().open_store()._folder == tmp_path / "mine"
    monkeypatch.setenv("CIIR_STORE_BYTES", "0")
    assert settings.read().open_store() is None


def test_limit_on_output_pixels(samples, eia):
    with TestClient(create_app(Settings(max_output_pixels=1000))) as client:
        wait_until_ready(client)
        problem(send(client, data=eia, lenses="6x9", views="all"), 413, "16 views", "1,000")


def test_models(client):
    listed = client.get("/v1/models").json()
    assert [model["name"] for model in listed] == catalogue.names()
    assert {"name", "kind", "scales", "takes", "default", "card"} == set(listed[0])


def test_views_of_a_grid_help_one_another_where_no_model_is_named(client, samples, eia, stand_in):
    response = send(client, data=eia, lenses="6x9", views="0,0;3,3", format="zip")
    with zipfile.ZipFile(io.BytesIO(response.content)) as archive:
        report = json.loads(archive.read("report.json"))
        picture = decode(archive.read("view_03_03.png"), name="x")
    assert (report["plan"]["model"], report["options"]["model"]) == ("field", "auto")
    assert "upscale;dur=" in response.headers["server-timing"]
    field = samples.EIA.reshape(6, 4, 9, 4, 3).transpose(1, 3, 0, 2, 4)
    assert np.abs(picture - samples.as_the_stand_in_has_it(field, (3, 3))).max() < 0.55  # rounded
    other = send(client, data=eia, lenses="6x9", views="0,0;3,3", format="zip", model="fast")
    assert other.headers["x-reconstruction-id"] != response.headers["x-reconstruction-id"]
    problem(send(client, data=eia, lenses="6x9", model="field", scale="3"), 422, "field upscales by 2, not 3")


def test_both_models_that_auto_takes_are_warm_before_it_is_ready(stand_in, monkeypatch):
    ran = []

    def noted(load):
        return lambda name, **options: ran.append(name) or load(name, **options)

    for loader in ("load", "load_light_field"):
        monkeypatch.setattr(catalogue, loader, noted(getattr(catalogue, loader)))
    call = type(stand_in).__call__
    monkeypatch.setattr(type(stand_in), "__call__", lambda *given, **more: ran.append("ran") or call(*given, **more))
    app_module._warm_up()
    assert set(ran) == {"fast", "field", "ran"}


def test_health(client):
    assert client.get("/healthz").json() == {"status": "alive"}
    assert client.get("/readyz").json() == {"status": "ready"}
    for path in ("/healthz", "/readyz"):
        head = client.head(path)
        assert (head.status_code, head.headers["content-type"]) == (200, "application/json")


def test_a_charset_that_is_none_is_the_clients_fault(client):
    body = b'--b\r\nContent-Disposition: form-data; name="views"\r\n\r\n\xff\r\n--b--\r\n'
    for charset in ("undefined", "UNDEFINED"):
        headers = {"Content-Type": f"multipart/form-data; boundary=b; charset={charset}"}
        problem(client.post("/v1/reconstructions", content=body, headers=headers), 400, "UTF-8")


def test_work_ends_when_the_client_has_gone(eia, monkeypatch):
    import threading

    gone, made = threading.Event(), []
    monkeypatch.setattr(turns, "BATCH_PIXELS", 1)  # a view at a time

    class SeesItLeave(FileSink):
        def add(self, view, pixels):
            made.append(view)
            gone.set()
            return super().add(view, pixels)

    monkeypatch.setattr(answers, "FileSink", SeesItLeave)
    options = Options(lenses=(6, 9), views="all", model="none")
    given = Upload("a.png", io.BytesIO(eia), options, "zip")
    with pytest.raises(ClientDisconnect):
        app_module._reconstruct(given, Settings(), None, gone)
    assert len(made) == 1
    with pytest.raises(ClientDisconnect):  # and one that was waiting does not begin
        app_module._reconstruct(given, Settings(), None, gone)
    assert len(made) == 1


def test_all_views_together_have_a_limit_of_samples(client):
    from service.pipeline import reconstruct
    from service.request import Options

    options = Options(lenses=(100, 100), views="all", model="none", sampling="lenslet")
    with pytest.raises(TooLarge, match="225 views of 160,000 samples"):
        reconstruct("vase", options, None, max_pixels=30_000_000)


def test_not_ready_while_models_are_loaded(eia, monkeypatch):
    import threading

    loaded = threading.Event()
    monkeypatch.setattr(app_module, "_warm_up", loaded.wait)
    with TestClient(create_app(Settings())) as client:
        problem(client.get("/readyz"), 503, "loaded")
        response = send(client, data=eia, lenses="6x9")
        problem(response, 503, "again")
        assert response.headers["retry-after"] == "1"
        assert client.get("/healthz").status_code == 200
        head = client.head("/readyz")
        loaded.set()
        wait_until_ready(client)
    assert head.status_code == 503


def test_never_ready_where_models_are_broken(monkeypatch, caplog):
    def fail():
        raise BadCard("broken")

    monkeypatch.setattr(app_module, "_warm_up", fail)
    with TestClient(create_app(Settings())) as client:
        until(lambda: "can't" in problem(client.get("/readyz"), 503))
        assert client.get("/healthz").status_code == 200


def test_docs_need_no_other_server(client):
    page = client.get("/docs").text
    assert "://" not in page
    for path in ("swagger-ui-bundle.js", "swagger-ui.css", "favicon-32x32.png"):
        assert f"/docs/static/{path}" in page
        assert client.get(f"/docs/static/{path}").status_code == 200


def test_openapi_tells_every_field(client):
    api = client.get("/openapi.json").json()
    assert api["openapi"].startswith("3.0")
    assert {(method.upper(), path) for path, item in api["paths"].items() for method in item} == set(ROUTES[:4])
    form = api["paths"][POST]["post"]["requestBody"]["content"]["multipart/form-data"]["schema"]
    assert set(form["properties"]) == {"file", "format", *NAMES}
    assert form["properties"]["format"]["enum"] == list(FORMATS)
    assert {"200", "400", "413", "415", "422", "503"} <= set(api["paths"][POST]["post"]["responses"])


def test_settings_come_from_the_environment(monkeypatch):
    monkeypatch.setenv("CIIR_WORKERS", "3")
    monkeypatch.setenv("CIIR_MAX_BODY_BYTES", "2048")
    found = settings.read()
    assert (found.workers, found.max_body_bytes) == (3, 2048)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("CIIR_WORKERS", "0", ["'0'", "1 to 64", "default of 2"]),
        ("CIIR_STORE_BYTES", "-1", ["'-1'", "0 to"]),
        ("CIIR_MAX_BODY_BYTES", "many", ["'many'", "1024 to", "default of 67108864"]),
        ("CIIR_MAX_OUTPUT_PIXELS", "1.5", ["'1.5'", "whole number"]),
    ],
)
def test_settings_out_of_range_are_told_in_plain_words(monkeypatch, name, value, words):
    monkeypatch.setenv(name, value)
    with pytest.raises(InvalidOption) as caught:
        settings.read()
    assert all(word in str(caught.value) for word in [name, *words]), caught.value
