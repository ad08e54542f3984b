import json

import numpy as np
import pytest

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.service.cli.main import main

MESH = ["scene:vase", "--lenses", "20x24", "--pixels", "3x3", "--backend", "raytrace"]


def read_pfm(path):
    header, size, _, data = path.read_bytes().split(b"\n", 3)
    assert header == b"Pf"
    width, height = map(int, size.split())
    return np.frombuffer(data, "<f4").reshape(height, width)[::-1]


def test_a_map_and_its_confidence(tmp_path, capsys):
    assert main(["depth", *MESH, "-o", str(tmp_path / "out.pfm"), "--report", str(tmp_path / "report.json")]) == 0
    disparity, confidence = read_pfm(tmp_path / "out.pfm"), read_pfm(tmp_path / "out_confidence.pfm")
    assert disparity.shape == confidence.shape == (20, 24)
    assert "out.pfm: disparity -" in (out := capsys.readouterr()).out
    assert "beside it out_confidence.pfm (decode " in out.out
    assert out.err == ""
    described = json.loads((tmp_path / "report.json").read_text())["disparity"]
    assert (described["file"], described["confidence"]) == ("out.pfm", "out_confidence.pfm")
    assert described["least"] == disparity.min()


def test_a_light_field_in_colours(tmp_path):
    LightField(np.random.default_rng(0).integers(0, 256, (3, 3, 16, 20, 3), np.uint8)).save(tmp_path / "in.npz")
    words = ["depth", str(tmp_path / "in.npz"), "--to", "viridis", "--view", "0,1", "--limits", "-1:1"]
    assert main([*words, "-o", str(tmp_path / "out.png")]) == 0
    assert decode((tmp_path / "out.png").read_bytes(), name="out").shape == (16, 20, 3)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "a.jpg"], "a.jpg: a disparity map can't have this name; end it with .pfm, .png, .npy"),
        (["-o", "a.pfm", "--to", "exr"], "format: 'exr' holds no disparity; give pfm, png"),
        (["-o", "a.pfm", "--limits", "0:1"], "limits, model: the disparity of a mesh is rendered"),
    ],
)
def test_what_cannot_be_done(tmp_path, capsys, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    assert main(["depth", *MESH, *words]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
