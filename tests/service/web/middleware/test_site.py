"""Other hosts and web pages of other sites."""

import httpx2
import pytest

from tests.support.inputs import EIA_PNG
from tests.support.servers import run_server
from tests.support.web import check_problem, run_app

POST = "/v1/reconstructions"
OWN = {"Host": "localhost:8000"}
PAGE = "https://page.example"


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with run_app(tmp_path_factory.mktemp("site"), hosts="Ciir.Example:80,10.0.0.7", cors_origins=PAGE) as client:
        yield client


@pytest.mark.parametrize(
    "host",
    ["localhost", "LOCALHOST:8000", "127.0.0.1", "127.8.8.8:1", "[::1]:8000", "ciir.example:443", "10.0.0.7", ""],
)
def test_hosts_of_the_server(client, host):
    assert client.get("/v1/models", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8000", "localhost.evil.example", "10.0.0.8", "[::2]", "[::1", "127.1.evil"]
)
def test_other_hosts(client, host):
    detail = check_problem(client.get("/v1/models", headers={"Host": host}), 403, "CIIR_HOSTS")
    assert repr(host) in detail
    assert "use 'ciir.example', or list this name" in detail
    assert client.get("/healthz", headers={"Host": host}).status_code == 200  # probes name whatever they like


def test_any_host_by_default_and_with_an_asterisk(tmp_path):
    for hosts in ({}, {"hosts": "*"}):
        with run_app(tmp_path, **hosts) as other:
            assert other.get("/v1/models", headers={"Host": "any.example"}).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Sec-Fetch-Site": "same-origin", "Origin": "https://proxied.example"},
        {"Sec-Fetch-Site": "none"},
        {"Origin": "http://localhost:8000"},
        {"Origin": PAGE, "Sec-Fetch-Site": "cross-site"},
    ],
)
def test_own_pages_and_programs(client, headers):
    check_problem(client.post(POST, headers=OWN | headers), 415, "multipart")  # it went through


@pytest.mark.parametrize(
    "headers",
    [
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
        {"Origin": "http://localhost:8001"},
        {"Origin": "null"},
        {"Origin": "https://evil.example", "Sec-Fetch-Site": "cross-site"},
    ],
)
def test_pages_of_other_origins(client, headers):
    for method, path in (("POST", POST), ("DELETE", f"{POST}/{'0' * 32}")):
        detail = check_problem(client.request(method, path, headers=OWN | headers), 403, "CIIR_CORS_ORIGINS")
        assert (headers.get("Origin") or f"Sec-Fetch-Site: {headers['Sec-Fetch-Site']!r}") in detail
    assert client.get("/v1/models", headers=OWN | headers).status_code == 200


def test_a_server_on_loopback_is_driven_by_no_web_page(tmp_path):
    with run_server(tmp_path / "log", CIIR_WORKERS="0") as server:
        evil = {"Host": "evil.example", "Origin": "http://evil.example", "Sec-Fetch-Site": "same-origin"}
        across = {"Origin": "https://evil.example", "Sec-Fetch-Site": "cross-site"}
        for headers, status in ((evil, 403), (across, 403), ({}, 202)):
            files = {"file": ("a.png", EIA_PNG)}
            response = httpx2.post(server.url + POST, files=files, headers=headers | {"Prefer": "respond-async"})
            assert response.status_code == status
