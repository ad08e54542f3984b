import pytest

from tests.support.web import check_problem, run_app

POST = "/v1/reconstructions"


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    with run_app(tmp_path_factory.mktemp("guarded"), api_keys="first,zweiter-schlüssel") as client:
        yield client


def test_a_server_without_keys_is_open(client):
    assert client.get("/v1/models").status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Authorization": "Bearer first"},
        {"authorization": "bearer first"},
        {"X-API-Key": "first"},
        {"X-API-Key": "zweiter-schlüssel".encode().decode("latin-1")},
        {"X-API-Key": "first", "Authorization": "Bearer another"},
    ],
)
def test_with_a_key(guarded, headers):
    given = {name: value.encode("latin-1") for name, value in headers.items()}
    assert guarded.get("/v1/models", headers=given).status_code == 200


@pytest.mark.parametrize(
    ("headers", "parts"),
    [
        ({}, "no API key"),
        ({"Authorization": "Basic first"}, "no API key"),
        ({"Authorization": "Bearer"}, "no API key"),
        ({"X-API-Key": ""}, "no API key"),
        ({"X-API-Key": "firs"}, "not known"),
        ({"Authorization": "Bearer first,zweiter-schlüssel"}, "not known"),
    ],
)
def test_without_a_key(guarded, headers, parts):
    given = {name: value.encode() for name, value in headers.items()}
    for method, path in [
        ("GET", "/v1/models"),
        ("GET", "/metrics"),
        ("POST", POST),
        ("GET", f"{POST}/{'0' * 32}"),
        ("DELETE", f"{POST}/{'0' * 32}"),
        ("GET", f"{POST}/{'0' * 32}/result"),
        ("GET", f"{POST}/{'0' * 32}/events"),
    ]:
        response = guarded.request(method, path, headers=given)
        check_problem(response, 401, parts, "Bearer KEY")
        assert response.headers["www-authenticate"].startswith("Bearer")


def test_health_and_docs_are_open(guarded):
    for path in ("/healthz", "/readyz", "/docs", "/openapi.json"):
        assert guarded.get(path).status_code == 200


def test_the_key_is_checked_before_the_body_is_read(guarded):
    read = []

    def body():
        read.append(1)
        yield b"x" * 100

    headers = {"content-type": "multipart/form-data; boundary=b"}
    check_problem(guarded.post(POST, content=body(), headers=headers), 401)
    check_problem(guarded.post(POST, content=b"nonsense", headers=headers | {"X-API-Key": "first"}), 400)
