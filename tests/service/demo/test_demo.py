import re

import numpy as np
import pytest

from ciir.models import catalogue
from ciir.renderer.readers.pictures import decode
from ciir.service.cli.main import main
from ciir.service.demo import demo


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(demo, "LENSES", (20, 20))
    monkeypatch.setattr(demo, "PIXELS", (3, 3))
    monkeypatch.setattr(demo, "SCENES", ("vase", "hamburger"))


def test_demo(small, tmp_path, capsys):
    out = tmp_path / "demo"
    assert main(["demo", "-o", str(out), "--backend", "raytrace"]) == 0
    pictures = {path.name: decode(path.read_bytes(), name=path.name) for path in out.iterdir()}
    assert {name: picture.shape[:2] for name, picture in pictures.items() if name != "contact_sheet.png"} == {
        "eia.png": (60, 60),
        "view_before.png": (20, 20),
        "view_after.png": (40, 40),
    }
    assert np.array_equal(pictures["view_before.png"], pictures["eia.png"][1::3, 1::3])
    header, *steps, vase, hamburger, last = capsys.readouterr().out.splitlines()
    assert header.split()[1:] == ["decode", "plan", "render", "map", "upscale", "encode", "total"]
    assert len(steps) == 2 * 4
    single, default = catalogue.picture_default_name(), catalogue.light_field_default_name()
    for scene, line in (("vase", vase), ("hamburger", hamburger)):
        decibels = r"[+-]\d+\.\d\d dB against"
        made = rf"{scene}: 9 views by {default}, the centre view \d+\.\d\d dB, SSIM 0\.\d{{3}}"
        assert re.fullmatch(rf"{made}: {decibels} bicubic, {decibels} {single}", line)
    assert last.endswith("eia.png, view_before.png, view_after.png of the hamburger; contact_sheet.png of all scenes")


def test_views_by_the_default_are_those_of_a_reconstruction(small, tmp_path):
    assert main(["demo", "-o", str(tmp_path / "demo"), "--backend", "raytrace"]) == 0
    arguments = [
        "reconstruct",
        str(tmp_path / "demo" / "eia.png"),
        "--lenses",
        "20x20",
        "-o",
        str(tmp_path / "view.png"),
    ]
    assert main(arguments) == 0
    demo_view, view = (tmp_path / "demo" / "view_after.png"), (tmp_path / "view.png")
    assert np.array_equal(*(decode(path.read_bytes(), name=path.name) for path in (demo_view, view)))
