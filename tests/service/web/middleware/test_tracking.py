import json
import logging
from hashlib import sha256

import pytest

from ciir.service import logs
from ciir.service.web.middleware.tracking import SECURITY_HEADERS
from tests.support.web import check_problem, post_file, run_app


@pytest.fixture
def lines(caplog):
    caplog.set_level(logging.INFO, logger="ciir.access")
    return lambda: [record for record in caplog.records if record.name == "ciir.access"]


@pytest.mark.parametrize("path", ["/healthz", "/nothing", "/v1/models", "/v1/reconstructions/0", "/openapi.json"])
def test_every_response_has_an_id_and_security_headers(client, path):
    response = client.get(path, headers={"X-Request-Id": "mine-1"})
    assert response.headers["x-request-id"] == "mine-1"
    for name, value in SECURITY_HEADERS.items():
        assert response.headers[name] == value


@pytest.mark.parametrize("given", [None, "", "two words", "x" * 65, "ein\tTab", 'quote"', "${jndi:x}"])
def test_an_invalid_id_is_replaced(client, given):
    response = client.get("/healthz", headers={} if given is None else {"X-Request-Id": given})
    assert len(response.headers["x-request-id"]) == 32
    assert response.headers["x-request-id"] != client.get("/healthz").headers["x-request-id"]


def test_every_request_is_one_line(client, lines):
    client.get("/v1/models?secret=1")
    client.get("/v1/%0aforged line")
    client.get("/healthz")  # not logged
    first, second = (record.getMessage() for record in lines())
    assert first.startswith("GET /v1/models 200 ")
    assert "secret" not in first
    assert "\n" not in second
    assert second.startswith("GET /v1/%0aforged%20line 404 ")


def test_lines_as_json(client, caplog, eia):
    caplog.set_level(logging.INFO, logger="ciir")
    caplog.handler.setFormatter(logs._Json())
    response = post_file(client, data=eia, lenses="6x9", headers={"X-Request-Id": "r-1"})
    entries = [json.loads(line) for line in caplog.text.splitlines() if '"logger": "ciir.' in line]
    assert [line["request_id"] for line in entries if "worker" in line] == ["r-1"] * 2  # a run's begin and end
    assert {line["request_id"] for line in entries} == {"r-1"}
    access = next(line for line in entries if line["logger"] == "ciir.access")
    assert {name: access[name] for name in ("method", "path", "status", "bytes_out", "level", "client")} == {
        "method": "POST",
        "path": "/v1/reconstructions",
        "status": 200,
        "bytes_out": len(response.content),
        "level": "INFO",
        "client": "testclient",
    }
    assert "key" not in access
    job = next(line for line in entries if line["logger"] == "ciir.jobs" and "worker" not in line)
    assert response.headers["x-reconstruction-id"] in job["message"]
    assert job["job"] == response.headers["x-reconstruction-id"]


@pytest.mark.parametrize("header", [{"X-API-Key": "first"}, {"Authorization": "Bearer first"}])
def test_a_line_names_the_key_by_its_digest(tmp_path, lines, header):
    with run_app(tmp_path, api_keys="first,second") as guarded:
        guarded.get("/v1/models", headers=header)
        guarded.get("/v1/models", headers={"X-API-Key": "wrong"})
    right, wrong = (record.fields for record in lines())
    assert (right["client"], right["key"]) == ("testclient", sha256(b"first").hexdigest()[:8])
    assert (wrong["client"], "key" in wrong) == ("testclient", False)
    assert "first" not in str(right)


def test_an_unexpected_exception_is_a_problem_with_an_id(client, eia, monkeypatch):
    def broken(*_, **__):
        raise KeyError("secret")

    monkeypatch.setattr(client.engine.jobs, "submit", broken)
    response = post_file(client, data=eia, lenses="6x9", headers={"X-Request-Id": "r-2"})
    assert "secret" not in check_problem(response, 500, "log")
    assert response.headers["x-request-id"] == "r-2"
    assert response.headers["x-content-type-options"] == "nosniff"
