"""The OpenAPI document agrees with what the server does: its schemas with real answers, its forms with the options."""

import pytest
import schemathesis

from ciir.errors import InvalidOption
from ciir.models import catalogue
from ciir.service.pipeline.options import FILE_TYPES, KINDS, NAMES, RECONSTRUCTION, Options
from ciir.service.web.routes.results import find_root
from tests.support.inputs import CUBE
from tests.support.web import run_app

MESH = {"lenses": "8x6", "pixels": "3x3", "backend": "raytrace"}
PANEL = "[panel]\npixels = [60, 40]\npitch = 0.1\n[lenses]\npitch = 1.0\ngap = 3.0\n"
GRID = {"lens_pitch": "5.5", "lens_offset": "2,2.5", "lens_rotation": "0", "lens_grid": "hexagonal-columns"}
REQUESTS = {
    "mesh": ("reconstruction", "cube.off", MESH),
    "mesh with a light-field network": ("reconstruction", "cube.off", MESH | {"model": "field", "neighbour_time": "9"}),
    "mesh rendered at the larger size": ("reconstruction", "cube.off", MESH | {"strategy": "direct"}),
    "elemental image array": ("reconstruction", "eia.png", {"lenses": "6x9", "views": "all", "format": "npz"}),
    "shipped scene": ("reconstruction", "scene:vase", MESH),
    "elemental of a shipped scene": ("elemental", "scene:globe", MESH),
    "views as mapped": ("reconstruction", "eia.png", {"lenses": "6x9", "model": "none"}),
    "a light field in another format": (
        "reconstruction",
        "eia.png",
        {"lenses": "6x9", "views": "all", "model": "none", "format": "webm", "frames": "3", "path": "sweep"},
    ),
    "picture": ("upscale", "eia.png", {}),
    "picture by interpolation": ("upscale", "eia.png", {"model": "bicubic", "format": "webp", "scale": "3"}),
    "elemental": ("elemental", "cube.off", MESH),
    "one plane": ("plane", "eia.png", {"lenses": "6x9", "disparity": "-0.5", "pitch": "1", "delta": "0.1"}),
    "planes of upscaled views": (
        "plane",
        "eia.png",
        {"lenses": "6x9", "stack": "-1:1:3", "model": "bicubic", "format": "npz"},
    ),
    "planes of a mesh": ("plane", "cube.off", MESH | {"stack": "1:20:3", "stack_of": "depths"}),
    "a view in focus everywhere": ("plane", "eia.png", {"lenses": "6x9", "all_in_focus": "yes"}),
    "a captured model": ("disparity", "cube.off", {**MESH, "lenses": "24x24", "format": "glb"}),
    "disparity": ("disparity", "eia.png", {"lenses": "6x9", "limits": "-2:2", "format": "png"}),
    "inspected mesh": ("inspection", "cube.off", {}),
    "inspected scene": ("inspection", "scene:globe", {}),
    "inspected picture": ("inspection", "eia.png", {}),
    "inspected elemental image array": ("inspection", "eia.png", {"lenses": "6x9"}),
    "inspected raw lenslet picture": ("inspection", "eia.png", GRID),
    "quilt": ("display", "eia.png", {"lenses": "6x9", "quilt": "2x2"}),
    "quilt of upscaled views": ("display", "eia.png", {"lenses": "6x9", "quilt": "2x2", "model": "fast"}),
    "panel's picture of a mesh": ("display", "cube.off", {"display": PANEL}),
    "disparity of a mesh": ("disparity", "cube.off", MESH | {"view": "0,2", "format": "zip"}),
}


@pytest.fixture(scope="module")
def document(client):
    return client.get("/openapi.json").json()


@pytest.fixture(scope="module")
def check(document):
    """Checks a response against the document, in which no object may have other keys than those it names."""
    strict = {
        name: schema | ({"additionalProperties": False} if "properties" in schema else {})
        for name, schema in document["components"]["schemas"].items()
    }
    api = schemathesis.openapi.from_dict(document | {"components": document["components"] | {"schemas": strict}})

    def check(response, path):
        assert str(response.status_code) in document["paths"][path][response.request.method.lower()]["responses"]
        api[path][response.request.method].validate_response(response)
        return response

    return check


@pytest.mark.parametrize("case", REQUESTS)
def test_real_answers(client, check, eia, case):
    kind, name, fields = REQUESTS[case]
    root = find_root(kind)
    scene = name.removeprefix("scene:")
    file = {"file": (name, eia if name.endswith("png") else CUBE)} if scene == name else {"scene": (None, scene)}
    accepted = check(client.post(root, files=file, data=fields, headers={"Prefer": "respond-async"}), root)
    assert accepted.status_code == 202
    done = check(client.post(root, files=file, data=fields), root)
    assert done.status_code == 200
    id_ = done.headers[f"x-{kind}-id"]
    status = check(client.get(f"{root}/{id_}"), root + "/{id}").json()
    assert {"result", "report"} <= set(status)
    assert check(client.get(f"{root}/{id_}/result"), root + "/{id}/result").content == done.content
    assert client.get(f"{root}/{id_}/events").text.count("event: done") == 1
    tag = {"If-None-Match": done.headers["etag"]}
    assert check(client.post(root, files=file, data=fields, headers=tag), root).status_code == 304


def test_problems_and_lists(client, check, tmp_path):
    for kind in KINDS:
        root = find_root(kind)
        failed = check(client.post(root, files={"file": ("a.glb", b"glTF" + bytes(40))}), root)
        assert failed.status_code in (415, 422)
        gone = "0" * 32
        for path in ("/{id}", "/{id}/result", "/{id}/events"):
            assert check(client.get(root + path.format(id=gone)), root + path).status_code == 404
    assert len(check(client.get("/v1/models"), "/v1/models").json()) == len(catalogue.list_names())
    for path in ("/healthz", "/readyz", "/metrics"):
        check(client.get(path), path)
    with run_app(tmp_path, api_keys="k", max_body_bytes=1024) as other:
        assert check(other.get("/v1/models"), "/v1/models").status_code == 401
        large = other.post("/v1/upscales", files={"file": ("a.png", bytes(2000))}, headers={"X-API-Key": "k"})
        assert check(large, "/v1/upscales").status_code == 413


def test_kept_files(client, check, eia):
    for status in (201, 200):
        sent = check(client.post("/v1/files", files={"file": ("kept.png", eia)}), "/v1/files")
        assert sent.status_code == status
    kept, fields = sent.json()["id"], {"lenses": "6x9", "disparity": "1"}
    planes = check(client.post("/v1/planes", files={"file_id": (None, kept)}, data=fields), "/v1/planes")
    assert planes.status_code == 200
    for status in (200, 404):
        for method in ("GET", "DELETE"):
            found = check(client.request(method, f"/v1/files/{kept}"), "/v1/files/{id}")
            assert found.status_code == status
    gone = check(client.post("/v1/upscales", files={"file_id": (None, kept)}), "/v1/upscales")
    assert gone.status_code == 410
    assert check(client.post("/v1/files", files={"scene": (None, "vase")}), "/v1/files").status_code == 422


def test_a_failed_job(client, check, eia):
    response = client.post("/v1/upscales", files={"file": ("a.png", eia[:60])}, headers={"Prefer": "respond-async"})
    path = response.headers["content-location" if response.status_code == 200 else "location"]
    client.get(f"{path}/events")  # to its end
    assert check(client.get(path), "/v1/upscales/{id}").json()["problem"]["status"] == 422


def test_a_job_is_of_one_kind(client, eia):
    id_ = client.post("/v1/upscales", files={"file": ("a.png", eia)}, data={"model": "bicubic"}).headers["x-upscale-id"]
    assert client.get(f"/v1/upscales/{id_}").status_code == 200
    for path in ("", "/result", "/events"):
        assert client.get(f"/v1/reconstructions/{id_}{path}").status_code == 404
    assert client.delete(f"/v1/elementals/{id_}").status_code == 404


def test_operation_ids_are_plain(document):
    found = {operation["operationId"] for item in document["paths"].values() for operation in item.values()}
    expected = {
        pattern.format(kind.title())
        for kind in KINDS
        for pattern in ("create{}", "get{}", "delete{}", "get{}Result", "get{}Events")
    }
    expected |= {"createFile", "getFile", "deleteFile"}
    assert found == expected | {"listModels", "getHealth", "getReadiness", "getMetrics"}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_a_form_names_every_option_with_its_values(document, kind):
    operation = document["paths"][find_root(kind.name)]["post"]
    assert operation["requestBody"]["content"]["multipart/form-data"]["schema"] == {
        "$ref": f"#/components/schemas/{kind.name.title()}Form"
    }
    assert {parameter["name"] for parameter in operation["parameters"]} == {"Prefer", "If-None-Match"}
    form = document["components"]["schemas"][f"{kind.name.title()}Form"]["properties"]
    assert set(form) == {"file", "file_id", "format", *kind.options} | ({"scene"} if kind.name != "upscale" else set())
    assert set(form["format"]["enum"]) <= set(FILE_TYPES)
    for name in kind.options:
        schema = form[name]
        Options.parse({name: str(schema["example"])})
        if "default" in schema:
            assert Options.parse({**kind.defaults, name: str(schema["default"])}) == Options.parse(kind.defaults), name
        for value in schema.get("enum", ()):
            Options.parse({name: value})
        if "maximum" in schema:
            for value in (schema["minimum"], schema["maximum"]):
                Options.parse({name: str(value)})
            for value in (schema["minimum"] - 1, schema["maximum"] * 2):
                with pytest.raises(InvalidOption):
                    Options.parse({name: str(value)})
        if "enum" in schema and name != "model":  # the job, not the options, finds that there is no such model
            with pytest.raises(InvalidOption):
                Options.parse({name: "other"})
    if "model" in form:
        names = catalogue.list_single_image_names() if kind.name == "upscale" else catalogue.list_names()
        assert set(form["model"]["enum"]) - {"auto", "none"} == set(names)


def test_every_option_is_of_some_kind():
    assert KINDS["reconstruction"].options == RECONSTRUCTION
    assert set().union(*(kind.options for kind in KINDS.values())) == set(NAMES)
