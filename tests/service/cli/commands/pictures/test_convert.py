import json

import numpy as np
import pytest

import ciir
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.service.cli.main import main

FIELD = LightField(np.random.default_rng(0).integers(0, 65535, (3, 4, 6, 5, 3), np.uint16), depth_sense="cameras")


@pytest.fixture
def given(tmp_path):
    FIELD.save(tmp_path / "in.npz")
    return tmp_path / "in.npz"


@pytest.mark.parametrize("name", ["out.npz", "out.npy", "out.zip", "out"])
def test_every_view_is_kept_as_it_is(given, tmp_path, capsys, name):
    assert main(["convert", str(given), "-o", str(tmp_path / name)]) == 0
    back = tmp_path / "back.npy"
    assert main(["convert", str(tmp_path / name), "-o", str(back), "--order", "given"]) == 0
    np.testing.assert_array_equal(np.load(back), FIELD.views)
    assert "3x4 views of 6x5 pixels" in capsys.readouterr().out


@pytest.mark.parametrize("scale", [2, 3])
def test_views_are_upscaled_first(given, tmp_path, capsys, scale):
    out = tmp_path / "out.npy"
    assert main(["convert", str(given), "-o", str(out), "--model", "bicubic", "--scale", str(scale)]) == 0
    np.testing.assert_array_equal(np.load(out), ciir.upscale(FIELD, model="bicubic", scale=scale).views)
    assert f"3x4 views of {6 * scale}x{5 * scale} pixels" in capsys.readouterr().out


def test_a_picture_is_the_elemental_image_array_as_lenses_see_it(given, tmp_path, capsys):
    assert main(["convert", str(given), "-o", str(tmp_path / "eia.png")]) == 0
    assert "note: eia counts pixels under lenses: views are written in reversed order" in capsys.readouterr().err
    eia = decode((tmp_path / "eia.png").read_bytes(), name="eia")
    np.testing.assert_array_equal(eia[::3, ::4], FIELD.views[-1, -1])
    assert main(["convert", str(tmp_path / "eia.png"), "--pixels", "3x4", "-o", str(tmp_path / "back.npy")]) == 0
    np.testing.assert_array_equal(np.load(tmp_path / "back.npy"), FIELD.with_depth_sense("lenses").views)
    assert main(["convert", str(tmp_path / "back.npy"), "-o", str(tmp_path / "again.png")]) == 0
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "eia.png").read_bytes()


def test_a_picture_named_as_eslf_is_eslf(given, tmp_path):
    assert main(["convert", str(given), "-o", str(tmp_path / "a_eslf.png")]) == 0
    FIELD.save(tmp_path / "b_ESLF.png")
    for name in ("a_eslf.png", "b_ESLF.png"):
        assert main(["convert", str(tmp_path / name), "-o", str(tmp_path / "back.npy"), "--order", "given"]) == 0
        np.testing.assert_array_equal(np.load(tmp_path / "back.npy"), FIELD.views)


def test_an_epi_and_the_report(given, tmp_path):
    words = ["convert", str(given), "--epi", "y=5,v=2", "-o", str(tmp_path / "epi.tif")]
    assert main([*words, "--report", str(tmp_path / "report.json")]) == 0
    epi = decode((tmp_path / "epi.tif").read_bytes(), name="x")
    np.testing.assert_array_equal(epi, FIELD.views[2, :, 5])
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["lens_array"]["depth_sense"] == "cameras"
    assert report["options"]["epi"] == "y=5,v=2"


def test_a_folder_by_its_name(given, tmp_path):
    assert main(["convert", str(given), "--to", "folder", "-o", str(tmp_path / "views.v1")]) == 0
    assert len(list((tmp_path / "views.v1").glob("view_*.png"))) == FIELD.views.shape[0] * FIELD.views.shape[1]


def test_a_mesh_is_rendered(tmp_path):
    words = ["convert", "scene:vase", "--lenses", "8x9", "--pixels", "2x3", "--backend", "raytrace"]
    assert main([*words, "-o", str(tmp_path / "vase.npy")]) == 0
    assert np.load(tmp_path / "vase.npy").shape == (2, 3, 8, 9, 3)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "a.exr"], "a.exr: a light field can't be written as .exr; end the name with .zip, .npz"),
        (["-o", "a.mpg"], "a.mpg: a light field can't be written as .mpg; end the name with .zip, .npz"),
        (["-o", "a.pfm"], "a.pfm: a light field can't be written as .pfm; end the name with .zip, .npz"),
        (["-o", "a.png", "--to", "exr"], "format: 'exr' is not known; give folder, zip, npz"),
        (["-o", "a.png", "--to", "png"], "format: 'png' is one picture, without the other views; give folder, zip, np"),
        (["-o", "a.zip", "--to", "folder"], "a.zip: a folder of views can't be written as .zip; end the name with / f"),
        (["-o", "a.png", "--to", "npy"], "a.png: npy is written as .npy; end the name with that"),
        (["-o", "a.png", "--to", "epi", "--epi", "y=9"], "epi: there is no y=9; give 0 to 5"),
        (["-o", "a.png", "--views", "all"], "unrecognized arguments: --views all"),
        (["-o", "in.npz"], "the input is there"),
        (
            ["-o", "a.npz", "--time", "0,0.1"],
            "time: 2 times make a video of one view, with `ciir reconstruct`; give one time for `ciir convert`",
        ),
        (["-o", "folder", "--fps", "5"], "fps: a folder of views has no use for it; leave it out, or give format mp4"),
    ],
)
def test_what_cannot_be_done(given, capsys, monkeypatch, words, message):
    monkeypatch.chdir(given.parent)
    assert main(["convert", "in.npz", *words]) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in given.parent.iterdir()] == ["in.npz"]
