import json
from pathlib import Path

import numpy as np
import pytest

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.service.cli.main import main

FIELD = LightField(np.random.default_rng(0).integers(0, 256, (3, 4, 16, 20, 3), np.uint8), depth_sense="cameras")


@pytest.fixture
def given(tmp_path):
    FIELD.save(tmp_path / "in.npz")
    return str(tmp_path / "in.npz")


def test_one_plane_is_a_picture(given, tmp_path, capsys):
    assert main(["refocus", given, "-o", str(tmp_path / "plane.png"), "--disparity", "-0.5", "--order", "given"]) == 0
    found = decode((tmp_path / "plane.png").read_bytes(), name="plane")
    np.testing.assert_array_equal(found, FIELD.refocus(-0.5))
    assert "plane.png: 1 plane, d-0.500, of 16x20 pixels (decode " in capsys.readouterr().out


def test_a_view_in_focus_everywhere(given, tmp_path, capsys):
    assert main(["refocus", given, "-o", str(tmp_path / "sharp.png"), "--all-in-focus", "--order", "given"]) == 0
    np.testing.assert_array_equal(decode((tmp_path / "sharp.png").read_bytes(), name="x"), FIELD.all_in_focus())
    assert "sharp.png: in focus everywhere, of 16x20 pixels" in capsys.readouterr().out


def test_a_stack_of_depths_is_a_folder(given, tmp_path, capsys):
    words = ["--stack", "20:40:2", "--stack-of", "depths", "--camera-pitch", "2", "--sensor", "36", "--focal-length"]
    assert main(["refocus", given, "-o", str(tmp_path / "out"), *words, "36", "--order", "given"]) == 0
    names = ["plane_000_z20mm.png", "plane_001_z40mm.png", "report.json"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    found = decode((tmp_path / "out" / names[1]).read_bytes(), name="plane")
    np.testing.assert_array_equal(found, FIELD.refocus(1.0))
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [plane["depth"] for plane in report["planes"]] == [20, 40]
    assert "2 planes, z20mm to z40mm, of 16x20 pixels" in capsys.readouterr().out


def test_a_stack_from_below_zero_in_any_format(given, tmp_path):
    for name in ("out.zip", "out.tif", "out.npy", "out.npz", "out.mp4"):
        report = tmp_path / "report.json"
        words = ["refocus", given, "-o", str(tmp_path / name), "--stack", "-1:1:3", "--report", str(report)]
        assert main(words) == 0, name
        assert [plane["disparity"] for plane in json.loads(report.read_text())["planes"]] == [-1, 0, 1]
        assert (tmp_path / name).stat().st_size > 100
    assert np.load(tmp_path / "out.npy").shape == (3, 16, 20, 3)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "a.png"], "no plane is asked for"),
        (["-o", "a.png", "--stack", "0:1:3"], "a.png: a stack of planes can't be written as .png; end the name with"),
        (["-o", "a.mp4", "--disparity", "0"], "a.mp4: one plane can't be written as .mp4; end the name with .png"),
        (["-o", "a.exr", "--disparity", "0"], "a.exr: one plane can't be written as .exr"),
        (["-o", "in.npz", "--disparity", "0"], "the input is there"),
        (["-o", "a.gif", "--stack", "0:1:3", "--fps", "60"], "fps: 60 is over the 50"),
        (["-o", "a.png", "--disparity", "0", "--fps", "9"], "fps: format png has no use for it; leave it out"),
        (["-o", "a.png", "--depth", "5"], "depth: the geometry of in.npz is unknown"),
        (["-o", "a.png", "--disparity", "0", "--views", "all"], "unrecognized arguments: --views all"),
    ],
)
def test_what_cannot_be_done(given, capsys, monkeypatch, words, message):
    folder = Path(given).parent
    monkeypatch.chdir(folder)
    assert main(["refocus", "in.npz", *words]) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["in.npz"]


def test_the_disparity_of_a_plane_is_listed_with_planes(capsys):
    with pytest.raises(SystemExit):
        main(["refocus", "--help"])
    headings = [part.splitlines() for part in capsys.readouterr().out.split("\n\n")]
    (group,) = [lines for lines in headings if any(line.strip().startswith("--disparity ") for line in lines)]
    assert group[0] == "planes and disparity:"
    assert any(line.strip().startswith("--depth ") for line in group)
