import re

import pytest
from fastapi.testclient import TestClient

from ciir.errors import BadCard
from ciir.models import catalogue
from ciir.service.jobs.workers import worker
from ciir.service.settings import Settings
from ciir.service.web.app import create_app
from tests.support.waiting import wait_until
from tests.support.web import check_problem, post_file, run_app
from tests.support.workers.pools import COLD


def test_health(client):
    assert client.get("/healthz").json() == {"status": "alive"}
    assert client.get("/readyz").json() == {"status": "ready"}
    for path in ("/healthz", "/readyz"):
        head = client.head(path)
        assert (head.status_code, head.headers["content-type"]) == (200, "application/json")


def test_not_ready_while_models_are_loaded(eia, tmp_path):
    with run_app(tmp_path) as client:
        client.pool.ready = False
        check_problem(client.get("/readyz"), 503, "loaded")
        response = post_file(client, data=eia, lenses="6x9", model="none")
        check_problem(response, 503, "again")
        assert response.headers["retry-after"] == "1"
        assert client.head("/readyz").status_code == 503
        assert client.get("/healthz").status_code == 200
        client.pool.ready = True
        assert client.get("/readyz").status_code == 200
        client.pool.ready = False  # workers are replaced: jobs wait in the queue
        check_problem(client.get("/readyz"), 503, "worker")
        assert post_file(client, data=eia, lenses="6x9", model="none").status_code == 200


def test_not_ready_while_no_worker_can_start(eia, tmp_path, monkeypatch):
    monkeypatch.setattr(worker, "MODULE", "missing_module")
    with TestClient(create_app(Settings(folder=tmp_path, workers=1))) as client:
        wait_until(lambda: "models are being loaded" not in client.get("/readyz").text)
        for response in (client.get("/readyz"), post_file(client, data=eia, lenses="6x9", model="none")):
            detail = check_problem(response, 503)
            assert detail == "a worker process can't be started (WorkerExitedError); the log says why"
        monkeypatch.setattr(worker, "MODULE", COLD)
        wait_until(lambda: client.get("/readyz").status_code == 200)


def test_models(client, monkeypatch):
    listed = client.get("/v1/models").json()
    assert [model["name"] for model in listed] == catalogue.list_names()
    assert {"name", "kind", "scales", "takes", "default", "unsupported_reason", "card"} == set(listed[0])
    monkeypatch.setattr("ciir.models.catalogue.processor.int8_unsupported_reason", lambda: "this processor has no VNNI")
    reasons = {model["name"]: model["unsupported_reason"] for model in client.get("/v1/models").json()}
    assert (reasons["fast"], reasons["fast-int8"]) == (None, "this processor has no VNNI")

    def bad_card():
        raise BadCard("/secret/path: broken")

    monkeypatch.setattr("ciir.models.catalogue.list_entries", bad_card)
    assert "secret" not in check_problem(client.get("/v1/models"), 500, "log")


def test_metrics(eia, tmp_path):
    with run_app(tmp_path) as client:
        for _ in range(2):
            post_file(client, data=eia, lenses="6x9", model="bicubic")
        post_file(client, data=b"nothing")
        client.get("/v1/reconstructions/nothing/result")
        client.request("HACK", "/nothing")
        response = client.get("/metrics")
        assert response.headers["content-type"].startswith("text/plain; version=")
        found = dict(line.rsplit(" ", 1) for line in response.text.splitlines() if not line.startswith("#"))
    route = 'method="POST",route="/v1/reconstructions"'
    assert float(found[f'ciir_http_requests_total{{{route},status="200"}}']) == 2
    assert float(found[f'ciir_http_requests_total{{{route},status="415"}}']) == 1
    assert float(found[f"ciir_http_request_seconds_count{{{route}}}"]) == 3
    assert 'ciir_http_requests_total{method="other",route="other",status="404"}' in found
    assert 'ciir_http_requests_total{method="GET",route="/v1/reconstructions/{id}/result",status="404"}' in found
    assert float(found['ciir_jobs_submitted_total{kind="accepted"}']) == 2
    assert float(found['ciir_jobs_submitted_total{kind="known"}']) == 1
    assert float(found['ciir_jobs_ended_total{status="200"}']) == 1
    assert float(found['ciir_jobs_ended_total{status="415"}']) == 1
    assert float(found['ciir_job_seconds_count{kind="reconstruction"}']) == 2
    for stage in ("decode", "plan", "map", "upscale", "encode"):
        assert float(found[f'ciir_stage_seconds_total{{stage="{stage}"}}']) > 0
    assert (float(found["ciir_queue_waiting"]), float(found['ciir_queue_jobs{lane="small",state="running"}'])) == (0, 0)
    assert (float(found["ciir_workers"]), float(found["ciir_workers_busy"])) == (2, 0)
    assert float(found["ciir_http_received_bytes_total"]) > 2 * len(eia)
    assert float(found["ciir_result_bytes_total"]) > 100
    assert float(found["ciir_model_pixels_total"]) == 54
    assert "ciir_model_pixels_skipped_total" in found
    assert float(found["process_resident_memory_bytes"]) > 1e6
    assert not [name for name in found if re.search("[0-9a-f]{32}", name)]  # no label grows with the jobs


@pytest.mark.parametrize("path", ["/v1/models", "/metrics", "/docs", "/healthz", "/readyz", "/openapi.json"])
def test_head_is_get_without_a_body(client, path):
    response = client.head(path)
    assert (response.status_code, response.content) == (200, b"")
    assert response.headers["content-type"] == client.get(path).headers["content-type"]
