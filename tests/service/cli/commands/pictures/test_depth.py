import json
import re
from pathlib import Path

import numpy as np
import pytest
import tifffile

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
    out = capsys.readouterr()
    assert re.search(r"out.pfm: disparity of view 1,1, -\S+ to -\S+ where the mesh is seen, ", out.out)
    assert "confidence in out_confidence.pfm (decode " in out.out
    assert out.err == ""
    described = json.loads((tmp_path / "report.json").read_text())["disparity"]
    assert (described["file"], described["confidence"]) == ("out.pfm", "out_confidence.pfm")
    assert described["least"] == disparity.min()


def test_a_tiff_and_its_confidence(tmp_path):
    for name in ("out.pfm", "out.tif"):
        assert main(["depth", *MESH, "-o", str(tmp_path / name)]) == 0
    for name in ("out", "out_confidence"):
        read = tifffile.imread(tmp_path / f"{name}.tif")
        assert read.dtype == np.float32
        np.testing.assert_array_equal(read, read_pfm(tmp_path / f"{name}.pfm"))


def test_a_light_field_in_colours(tmp_path, capsys):
    LightField(np.random.default_rng(0).integers(0, 256, (3, 3, 16, 20, 3), np.uint8)).save(tmp_path / "in.npz")
    words = ["depth", str(tmp_path / "in.npz"), "--to", "viridis", "--view", "0,1", "--limits", "-1:1"]
    assert main([*words, "-o", str(tmp_path / "out.png")]) == 0
    assert decode((tmp_path / "out.png").read_bytes(), name="out").shape == (16, 20, 3)
    assert re.search(
        r" \(1st to 99th percentile\) where texture has a confidence of 0\.\d+ or more, 16x20 pixels",
        capsys.readouterr().out,
    )


def test_a_light_field_without_texture(tmp_path, capsys):
    LightField(np.full((3, 3, 16, 20, 3), 128, np.uint8)).save(tmp_path / "in.npz")
    assert main(["depth", str(tmp_path / "in.npz"), "-o", str(tmp_path / "out.npy")]) == 0
    assert "out.npy: disparity of view 1,1, which has too little texture to tell, 16x20" in capsys.readouterr().out


def test_a_model_is_rendered_again(tmp_path, capsys):
    model, array = str(tmp_path / "model.glb"), ["--lenses", "32x32", "--pixels", "5x5", "--backend", "raytrace"]
    assert main(["depth", "scene:vase", *array, "-o", model]) == 0
    assert "model.glb: a 3D model of " in capsys.readouterr().out
    first, again = str(tmp_path / "first.png"), str(tmp_path / "again.png")
    assert main(["elemental", "scene:vase", *array, "-o", first]) == 0
    assert main(["elemental", model, *array, "-o", again, "--fit", "none"]) == 0
    truth, made = (decode(Path(path).read_bytes(), name=path).astype(float) for path in (first, again))
    assert 10 * np.log10(255**2 / np.square(truth - made).mean()) > 22  # outlines of 32 pixels are coarse


def test_points_of_a_model(tmp_path, capsys):
    out = tmp_path / "out.ply"
    assert main(["depth", *MESH, "-o", str(out), "--points"]) == 0
    count = int(re.search(rb"element vertex (\d+)", out.read_bytes())[1])
    assert b"element face" not in out.read_bytes()
    assert f"out.ply: a 3D model of {count} points" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["-o", "a.jpg"],
            "a.jpg: not the name of a disparity map or a 3D model; end it with .pfm, .tif, .tiff, .png, .npy, .glb",
        ),
        (["-o", "a.pfm", "--to", "exr"], "format: 'exr' holds no disparity; give pfm, tiff, png"),
        (["-o", "a.glb", "--points"], "points: only a PLY holds points; leave it out or make a ply"),
        (
            ["-o", "a.pfm", "--camera-pitch", "2", "--sensor", "36", "--focal-length", "35"],
            "--camera-pitch: it places a 3D model and changes no disparity; leave it out or make a glb or ply",
        ),
        (["-o", "a.pfm", "--limits", "0:1"], "limits: the disparity of a mesh is rendered"),
    ],
)
def test_what_cannot_be_done(tmp_path, capsys, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    assert main(["depth", *MESH, *words]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
