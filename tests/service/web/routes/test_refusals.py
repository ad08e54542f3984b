"""Jobs that are not run, or fail."""

import numpy as np
import pytest

from ciir.errors import QueueFull, QueueUnavailable
from ciir.renderer.writers.pictures import encode_png
from ciir.service.jobs.job import Problem
from tests.support.web import POST, check_problem, post_file, run_app


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


@pytest.mark.parametrize("id_", ["0" * 32, "x", "0" * 33, "%2e%2e", "A" * 32])
def test_an_unknown_job(client, id_):
    for path in ("", "/result", "/events"):
        check_problem(client.get(f"{POST}/{id_}{path}"), 404, "post")
    check_problem(client.delete(f"{POST}/{id_}"), 404)


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
        raise QueueFull("the queue is full: 2 jobs wait, and the limit is 2; try again in 7 s", 7)

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


def test_a_long_path_is_cut(client):
    response = client.get("/" + "x" * 10_000)
    assert (response.status_code, len(response.content) < 500) == (404, True)
    assert response.json()["instance"] == "/" + "x" * 199


@pytest.mark.parametrize(
    ("fields", "part", "other"),
    [
        ({"views": "cross", "format": "png"}, "give zip or npz, or one view", "folder"),
        ({"format": "quilt"}, "or POST to /v1/displays", "ciir"),
        ({"rotate": "0:90:3", "views": "all"}, "give one of them with views", "ciir"),
    ],
)
def test_remedies_can_be_followed_over_http(client, fields, part, other):
    given = {"scene": "vase", "lenses": "5x5", "model": "none", **fields}
    response = client.post(POST, files={name: (None, value) for name, value in given.items()})
    assert other not in check_problem(response, 422, part)


def test_a_photo_is_upscaled_by_another_request(client):
    photo = encode_png(np.random.default_rng(0).integers(0, 256, (31, 37, 3), np.uint8))
    detail = check_problem(post_file(client, "photo.png", photo, model="none"), 422)
    assert detail.endswith("an ordinary photo is upscaled with POST /v1/upscales")
