"""What holds for all routes; tests of single routes are in tests/service/web/routes."""

import re
from urllib.parse import quote

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.service.pipeline.options import KINDS
from ciir.service.web.routes.results import find_root
from tests.support.web import check_problem, run_app

POST = "/v1/reconstructions"
ROUTES = (
    *(
        (method, f"{find_root(kind)}{path}")
        for kind in KINDS
        for method, path in (
            ("POST", ""),
            ("GET", "/{id}"),
            ("DELETE", "/{id}"),
            ("GET", "/{id}/result"),
            ("GET", "/{id}/events"),
        )
    ),
    ("GET", "/v1/models"),
    ("GET", "/metrics"),
    ("GET", "/healthz"),
    ("GET", "/readyz"),
)


@pytest.mark.parametrize(("method", "path"), [*ROUTES, ("GET", "/docs"), ("GET", "/openapi.json")])
def test_another_method_is_a_problem(client, method, path):
    other = "GET" if method == "POST" else "POST"
    response = client.request(other, path.format(id="0" * 32))
    check_problem(response, 405, "method")
    assert method in response.headers["allow"]


def test_allow_lists_all_methods_of_a_path(client):
    for path, methods in {
        f"{POST}/{'0' * 32}": "GET, HEAD, DELETE",
        "/docs/static/swagger-ui.css": "GET, HEAD",
    }.items():
        response = client.put(path)
        assert (response.status_code, response.headers["allow"]) == (405, methods)


@pytest.mark.parametrize("path", ["/v1", "/v1/nothing", "/assets", "/docs/static/gone.js", "/docs/static/../app.py"])
def test_an_unknown_path_is_a_problem(client, path):
    check_problem(client.get(path), 404, "/docs")


@pytest.mark.parametrize("path", ["/v1/models/", "/docs/", "/docs/static", f"{POST}/"])
def test_a_path_with_another_slash_redirects_nowhere(client, path):
    response = client.get(path, headers={"Host": "evil.example"}, follow_redirects=False)
    check_problem(response, 404, "/docs")
    assert "location" not in response.headers


def test_openapi_describes_every_error_as_a_problem(client):
    api = client.get("/openapi.json").json()
    assert api["openapi"].startswith("3.0")
    for method, path in ROUTES:
        responses = api["paths"][path][method.lower()]["responses"]
        for status in {"default", *(status for status in responses if status >= "400")}:
            assert set(responses[status]["content"]) == {"application/problem+json"}, (path, status)
    assert '"null"' not in client.get("/openapi.json").text  # not in OpenAPI 3.0


def test_docs_load_nothing_from_other_servers(client):
    response = client.get("/docs")
    page, policy = response.text, response.headers["content-security-policy"]
    assert "://" not in page
    for path in ("swagger-ui-bundle.js", "swagger-ui.css", "favicon-32x32.png"):
        assert f"/docs/static/{path}" in page
        assert client.get(f"/docs/static/{path}").status_code == 200
    assert "unsafe-inline" not in re.search(r"script-src[^;]*", policy)[0]
    assert len(re.findall("'sha256-", policy)) == page.count("<script>") == 1


def test_only_listed_origins_are_allowed(client, tmp_path):
    preflight = {"Origin": "https://example.org", "Access-Control-Request-Method": "POST"}
    assert "access-control-allow-origin" not in client.get("/healthz", headers=preflight).headers
    assert client.options(POST, headers=preflight).status_code == 405
    with run_app(tmp_path, cors_origins="https://example.org,https://example.com") as other:
        allowed = other.options(POST, headers=preflight)
        assert allowed.headers["access-control-allow-origin"] == "https://example.org"
        exposed = other.get("/healthz", headers=preflight).headers["access-control-expose-headers"]
        exposed_to_pages = {"Accept-Ranges", "Content-Disposition", "Content-Range", "ETag", "Location", "Retry-After"}
        assert exposed_to_pages <= set(exposed.split(", "))
        asked = {"Access-Control-Request-Headers": "range, if-range, if-none-match"}
        assert other.options(POST, headers=preflight | asked).status_code == 200
        asked = {"Access-Control-Request-Headers": "x-mine"}
        unlisted = other.options(POST, headers=preflight | asked).json()["detail"]
        assert unlisted.startswith("Disallowed CORS headers; ")
        assert unlisted.endswith("Range, If-Range, Last-Event-ID")
        refused = other.options(POST, headers=preflight | {"Origin": "https://example.net"})
        assert "access-control-allow-origin" not in refused.headers
        assert (refused.status_code, refused.headers["content-type"]) == (400, "application/problem+json")
        assert refused.json()["detail"].startswith("Disallowed CORS origin; ")
        assert "Origin" in refused.headers["vary"]


HEADERS = (
    *("Accept", "Authorization", "Content-Type", "Expect", "If-None-Match", "Last-Event-ID", "Origin", "Prefer"),
    *("Host", "Range", "Sec-Fetch-Site", "Traceparent", "Transfer-Encoding", "X-API-Key", "X-Request-Id"),
)
VALUES = st.one_of(
    st.binary(max_size=40).map(lambda value: value.translate(None, b"\r\n\0")),  # what h11 accepts
    st.sampled_from([b'W/"', b"respond-async, wait=99999999999", b"Bearer ", b"-1", b"multipart/form-data; boundary="]),
)


@given(
    st.sampled_from([*ROUTES, ("PUT", "/docs")]),
    st.text(max_size=40),
    st.dictionaries(st.sampled_from(HEADERS), VALUES),
)
@settings(max_examples=150)
def test_no_path_or_header_causes_a_server_error(client, route, id_, headers):
    method, path = route
    response = client.request(method, path.format(id=quote(id_, safe="")), headers=headers)
    assert response.status_code < 500, response.text
    assert response.headers["x-request-id"]
    if response.status_code >= 400:
        assert response.headers["content-type"] == "application/problem+json"
