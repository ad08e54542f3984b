"""Pictures for displays over HTTP, in worker processes with their restrictions."""

import json

import numpy as np
import pytest

import ciir
from ciir.renderer.displays.integral import parse_display
from ciir.renderer.displays.panel import resample_panel
from ciir.renderer.displays.quilt import QuiltLayout, QuiltName, parse_name, split_quilt
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.service.cli.main import main
from tests.support.displays import CALIBRATION
from tests.support.inputs import CUBE
from tests.support.light_fields import make_views
from tests.support.web import run_app

PANEL = "[panel]\npixels = [60, 40]\npitch = 0.1\n[lenses]\npitch = 1.0\ngap = 3.0\n"
JSON = json.dumps(CALIBRATION)
FIELD = LightField(make_views((1, 6), disparities=(0, 1), side=24, channels=3), depth_sense="cameras")


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    path = tmp_path_factory.mktemp("views") / "in.npz"
    FIELD.save(path)
    return "in.npz", path.read_bytes()


def post(client, file, parts=(), **fields):
    files = {"file": file} | {name: (f"{name}.txt", text) for name, text in dict(parts).items()}
    return client.post("/v1/displays", files=files, data=fields)


def read(response):
    assert response.status_code == 200, response.text
    return decode(response.content, name="a")


def name_of(response):
    return response.headers["content-disposition"].partition('filename="')[2].strip('"')


def test_a_quilts_name_holds_its_layout(client, views):
    made = post(client, views, quilt="3x2")
    assert np.array_equal(split_quilt(read(made), QuiltLayout(3, 2, 1.0), name="q"), FIELD.views[0])
    assert name_of(made) == f"{made.headers['x-display-id']}_qs3x2a1.png"
    kept = client.get(f"/v1/displays/{made.headers['x-display-id']}/result")
    assert parse_name(name_of(kept)) == QuiltName(3, 2, 1.0)
    assert parse_name(name_of(post(client, views, device="8.9"))) == QuiltName(5, 9, 1.6)
    assert parse_name(name_of(post(client, views, device="8.9", aspect="1.25"))) == QuiltName(5, 9, 1.25)


def test_views_are_upscaled_first(client, views):
    large = post(client, views, quilt="3x2", model="bicubic", scale="3")
    expected = ciir.upscale(FIELD, model="bicubic", scale=3).views[0]
    assert np.array_equal(split_quilt(read(large), QuiltLayout(3, 2, 1.0), name="q"), expected)


@pytest.mark.parametrize("is_file", [True, False])
def test_descriptions_are_files_or_plain_fields(client, views, tmp_path, is_file):
    def show(name, text, **fields):
        return post(client, views, {name: text}, **fields) if is_file else post(client, views, **fields | {name: text})

    native = show("calibration", JSON)
    (tmp_path / "c.json").write_text(JSON)
    FIELD.save(tmp_path / "a.png", "lenticular", calibration=tmp_path / "c.json")
    assert np.array_equal(read(native), decode((tmp_path / "a.png").read_bytes(), name="a"))
    assert name_of(native) == f"{native.headers['x-display-id']}.png"
    panel = read(show("display", PANEL, conversion="none", disparity="0.5"))
    display = parse_display(PANEL.encode(), name="p")
    assert b"pHYs" in show("display", PANEL).content[:100]
    assert np.array_equal(panel, resample_panel(FIELD.views, display, conversion="none", disparity=0.5))


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (({"calibration": JSON}, {}), "-o o.png --calibration c.json"),
        (
            ({}, {"print": "1x0.5in", "lpi": "20", "dpi": "80", "view_distance": "100mm", "view_angle": "50"}),
            "-o o.png --print 1x0.5in --lpi 20 --dpi 80 --view-distance 100mm --view-angle 50",
        ),
        (({"display": PANEL}, {"rotate": "30,0,0", "format": "panel"}), "-o o.png --display p.toml --rotate 30,0,0"),
    ],
    ids=["lenticular", "print", "panel"],
)
def test_a_mesh_becomes_what_the_command_line_makes(client, tmp_path, monkeypatch, sent, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cube.off").write_bytes(CUBE)
    (tmp_path / "c.json").write_text(JSON)
    (tmp_path / "p.toml").write_text(PANEL)
    assert main(["convert", "cube.off", *words.split(), "--report", "r.json"]) == 0
    parts, fields = sent
    made = post(client, ("cube.off", CUBE), parts, **fields)
    assert np.array_equal(read(made), decode((tmp_path / "o.png").read_bytes(), name="a"))
    status = client.get(made.headers["content-location"].removesuffix("/result")).json()
    report = json.loads((tmp_path / "r.json").read_text())
    assert status["report"]["display"] == report["display"]
    assert status["report"]["notes"] == report["notes"]


@pytest.mark.parametrize(
    ("fields", "parts", "expected"),
    [
        ({"format": "panel"}, {}, (422, "display: a panel's picture needs it")),
        ({"format": "lenticular"}, {"display": PANEL}, (422, "display: format lenticular has no use for it")),
        ({}, {"display": "["}, (422, "display: not TOML")),
        ({}, {"calibration": "[]"}, (422, "calibration: no calibration; give the JSON")),
        ({}, {"calibration": b"\xff"}, (422, "calibration: not text in UTF-8")),
        ({}, {"calibration": b"x" * 70_000}, (413, "calibration: over 65,536 bytes")),
        ({}, {"device": "go"}, (422, "device: a file; only 'file' and 'calibration' and 'display' may be one")),
        ({"display": PANEL.replace("60, 40", "60000, 40000")}, {}, (413, "at most 67,108,864")),
        ({"print": "6x4in", "dpi": "600"}, {}, (422, "lpi: a print needs it")),
        (
            {"print": "1x0.5in", "lpi": "2", "dpi": "80", "format": "quilt"},
            {},
            (422, "print: format quilt has no use for"),
        ),
        ({"print": "60x40in", "lpi": "60", "dpi": "600"}, {}, (413, "36000x24000 pixels; at most 67,108,864 are made")),
        ({"format": "png"}, {}, (422, "format: 'png' is not known; give quilt, lenticular, panel, or POST to /v1/rec")),
        ({"views": "all"}, {}, (422, "'views': no such field")),
    ],
)
def test_mistakes_are_problems(client, views, fields, parts, expected):
    status, message = expected
    response = post(client, views, parts, **fields)
    assert response.status_code == status
    assert message in response.json()["detail"]


def test_reconstructions_name_the_route_of_displays(client, views):
    response = client.post("/v1/reconstructions", files={"file": views}, data={"format": "quilt", "views": "all"})
    assert response.status_code == 422
    assert response.json()["detail"].endswith("or POST to /v1/displays")


def test_rays_over_the_servers_limit_are_refused(tmp_path):
    with run_app(tmp_path, max_output_pixels=20_000) as client:
        response = post(client, ("cube.off", CUBE), {"display": PANEL})
        assert response.status_code == 413
        remedy = "give a display with fewer pixels"
        assert f"a picture of 28,800 rays is over the limit of 20,000; {remedy}" in response.json()["detail"]
        sheet = {"print": "1x1in", "lpi": "40", "dpi": "100"}
        response = post(client, ("cube.off", CUBE), **sheet, format="lenticular")
        assert response.json()["detail"].endswith("; give a lower dpi")


def test_larger_views_keep_to_the_servers_limit(tmp_path, views):
    with run_app(tmp_path, max_output_pixels=6 * 48 * 48) as client:
        assert post(client, views, quilt="3x2", model="bicubic").status_code == 200
        response = post(client, views, quilt="3x2", model="bicubic", scale="3")
        assert response.status_code == 413
        assert "6 views of 72x72 pixels" in response.json()["detail"]
