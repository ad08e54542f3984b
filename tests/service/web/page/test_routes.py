import json
import re
import shutil
import subprocess
from base64 import b64encode
from hashlib import sha256
from pathlib import Path

import pytest

from ciir.renderer.scenes import SCENES
from ciir.renderer.writers.depth import maps
from ciir.service.pipeline.options import KINDS
from ciir.service.web.page import routes
from tests.support.paths import ROOT
from tests.support.web import check_problem, run_app

TYPES = {"css": "text/css", "html": "text/html", "jpg": "image/jpeg", "js": "text/javascript", "svg": "image/svg+xml"}
TSC = shutil.which("tsc")


@pytest.mark.parametrize("path", ["/", "/embed"])
def test_a_page_loads_files_of_this_server_alone(client, path):
    response = client.get(path)
    assert response.headers["content-type"] == "text/html; charset=utf-8"
    names = re.findall(r'(?:src|href)="([^"#][^"]*)"', response.text)
    assert names
    for name in names:
        assert name.startswith("/assets/")
        assert client.get(name).status_code == 200


@pytest.mark.parametrize("path", ["/", "/embed"])
def test_the_policy_allows_no_inline_code_and_no_other_host(client, path):
    policy = client.get(path).headers["content-security-policy"]
    directives = dict(directive.split(" ", 1) for directive in policy.split("; "))
    assert directives["default-src"] == directives["base-uri"] == directives["form-action"] == "'none'"
    assert directives["style-src"] == "'self'"
    assert "unsafe" not in policy
    assert "://" not in policy
    sources = " ".join(text for name, text in directives.items() if name != "frame-ancestors")
    import_map = re.findall(r"<script[^>]*>([^<]+)</script>", client.get("/").text)
    allowed = [f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'" for text in import_map]
    assert len(allowed) == 1
    assert set(sources.split()) == {"'none'", "'self'", "blob:", "data:", *allowed}
    assert directives["script-src"].split() == ["'self'", *allowed]


def test_only_the_viewer_may_be_framed(client):
    for path, frames, header in (("/", "'none'", "DENY"), ("/embed", "*", None), ("/assets/main.js", "'none'", "DENY")):
        headers = client.get(path).headers
        assert headers["content-security-policy"].endswith(f"frame-ancestors {frames}")
        assert headers.get("x-frame-options") == header


@pytest.mark.parametrize("path", ["/", "/embed", *(f"/assets/{name}" for name in routes.FILES)])
def test_a_file_has_its_type_and_is_sent_once(client, path):
    name = {"/": "index.html", "/embed": "embed.html"}.get(path, path.removeprefix("/assets/"))
    response = client.get(path)
    assert response.content == routes.FILES[name].read_bytes()
    assert response.headers["content-type"].split(";")[0] == TYPES[name.rpartition(".")[2]]
    assert response.headers["x-content-type-options"] == "nosniff"
    assert response.headers["referrer-policy"] == "no-referrer"
    tag = response.headers["etag"]
    again = client.get(path, headers={"If-None-Match": tag})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
    assert client.get(path, headers={"If-None-Match": '"other"'}).status_code == 200
    head = client.head(path)
    assert (head.status_code, head.content, head.headers["etag"]) == (200, b"", tag)


def test_the_names_of_formats_are_those_of_the_registries(client):
    lines = dict(re.findall(r"^export const (\w+) = (.+);$", client.get("/assets/formats.js").text, re.MULTILINE))
    assert json.loads(lines["MAPS"]) == list(maps.FORMATS)
    assert {*json.loads(lines["PICTURES"]), *json.loads(lines["WHOLE"]), "epi"} == set(KINDS["reconstruction"].formats)


def test_names_with_a_version_never_change(client, monkeypatch, tmp_path):
    (tmp_path / "a.js").write_text("1")
    monkeypatch.setitem(routes.FILES, "vendor/a-1.0/a.js", tmp_path / "a.js")
    assert "immutable" in client.get("/assets/vendor/a-1.0/a.js").headers["cache-control"]
    assert client.get("/assets/main.js").headers["cache-control"] == "no-cache"


@pytest.mark.parametrize(
    "name", ["", "gone.js", "../routes.py", "%2e%2e/routes.py", "..%2froutes.py", "viewer/../../html.py", "/etc/passwd"]
)
def test_nothing_else_is_a_file_of_the_page(client, name):
    check_problem(client.get(f"/assets/{name}"), 404)


def test_the_viewer_is_that_of_the_html_export(client):
    assert b"class LightFieldViewer" in client.get("/assets/viewer/viewer.js").content


def test_the_page_needs_no_key_and_the_api_does(tmp_path):
    with run_app(tmp_path, api_keys="k") as other:
        for path in ("/", "/embed", "/assets/main.js"):
            assert other.get(path).status_code == 200
        check_problem(other.get("/v1/models"), 401)


def test_the_page_is_for_the_hosts_of_the_server(tmp_path):
    with run_app(tmp_path, hosts="ciir.example") as other:
        assert other.get("/", headers={"Host": "ciir.example"}).status_code == 200
        check_problem(other.get("/", headers={"Host": "evil.example"}), 403, "Host")


def test_every_text_of_the_page_stands_in_texts():
    assets = Path(routes.FILES["index.html"]).parent
    own = "texts.js", "server_texts.js"
    written = "".join((assets / name).read_text() for name in own)
    texts = set(re.findall(r"^  (\w+):", written, re.MULTILINE))
    for page in ("index.html", "embed.html"):
        html = re.sub(r"<script.*", "", (assets / page).read_text())
        assert set(re.findall(r'data-text="(\w+)"', html)) <= texts
        assert set(re.findall(r">\s*([^<>\s][^<>]*)<", html)) <= {"ciir", *SCENES}
    files = [path for name, path in routes.FILES.items() if not name.startswith(("vendor/", "viewer/"))]
    others = [path for path in files if path.suffix in {".js", ".html"} and path.name not in own]
    for path in others:
        code = re.sub(r"/\*[\s\S]*?\*/|//.*", "", path.read_text())
        assert not re.findall(r"""["'`][A-Z][a-z]+ [a-z][^"'`]*""", code), path.name
    code = "".join(path.read_text() for path in others)
    for block in re.findall(r"const (?:PICTURE_)?(?:TEXTS|SENTENCES) = {.*?^}", written, re.DOTALL | re.MULTILINE):
        names = re.findall(r"^  (\w+):", block, re.MULTILINE)
        used = r'(?:TEXTS|SENTENCES)\.{0}\b|"{0}"'
        assert [name for name in names if not re.search(used.format(name), code)] == []


@pytest.mark.skipif(TSC is None, reason="needs tsc, the TypeScript compiler (node-typescript in Debian)")
def test_the_scripts_have_consistent_types():
    project = ROOT / "service" / "web" / "page" / "tsconfig.json"
    done = subprocess.run([TSC, "-p", project], capture_output=True, text=True, check=False)  # noqa: S603
    assert (done.returncode, done.stdout) == (0, "")
