"""Raw lenslet pictures on the command line and in Python: files that go with them."""

import json

import numpy as np
import pytest

import ciir
from ciir.renderer.readers.lenslet import reader
from ciir.renderer.readers.lenslet.calibration import calibrate
from ciir.renderer.readers.lenslet.grid import LensGrid
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from ciir.service.cli.main import main
from ciir.service.pipeline.inspection.report import inspect
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.source import open_source
from tests.support.inputs import CUBE
from tests.support.lenslet.camera import make_camera, take_picture
from tests.support.lenslet.lytro import expose, make_metadata, pack, write_container

GRID = ["--lens-pitch", "9.3", "--lens-offset", "4.2,5.1", "--lens-rotation", "0.5", "--lens-grid", "square"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    camera = make_camera("vase", LensGrid(9.3, (4.2, 5.1), 0.5), (150, 180), (200, 200, 200))
    (tmp_path / "raw.png").write_bytes(encode_png(take_picture(camera)))
    (tmp_path / "white.png").write_bytes(encode_png(take_picture(camera, white=True)))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_grid_is_found_once_reported_and_drawn(folder, capsys, monkeypatch):
    words = ["raw.png", "--lens-pitch", "auto", "--model", "none", "-o", "out", "--report", "report.json"]
    calls = []
    monkeypatch.setattr(reader, "calibrate", lambda *given, **words: calls.append(0) or calibrate(*given, **words))
    assert main(["reconstruct", *words, "--show-grid", "grid.png"]) == 0
    assert len(calls) == 1
    report = json.loads((folder / "report.json").read_text())
    assert report["input"]["kind"] == "png"
    assert report["lens_array"]["pitch"] == pytest.approx(9.3, abs=0.01)  # pixels
    assert "note: lens grid: square, pitch 9.3" in capsys.readouterr().err
    grid = decode((folder / "grid.png").read_bytes(), name="grid")
    assert grid.shape == (150, 180, 3)
    assert (grid == (0, 255, 255)).all(axis=2).sum() > 15 * 18  # a mark for each lens


def test_the_grid_of_a_lytro_picture_is_drawn_without_a_pitch(folder):
    grid = LensGrid(14.286, (5.3, 8.8), -0.05, "hexagonal")
    metadata = make_metadata(grid, (100, 120))
    mosaic = expose(np.full((100, 120, 3), 99), metadata)
    (folder / "a.lfp").write_bytes(write_container(pack(mosaic, 12), metadata))
    assert main(["reconstruct", "a.lfp", "--model", "none", "-o", "out", "--show-grid", "grid.png"]) == 0
    assert decode((folder / "grid.png").read_bytes(), name="grid").shape == (100, 120, 3)


def test_frames_are_read_from_their_own_paths(folder, capsys):
    words = ["convert", "raw.png", *GRID, "-o", "out.npy", "--report", "report.json"]
    assert main([*words, "--white", "white.png"]) == 0
    evened = np.load("out.npy")[1:-1, 1:-1, 0, 0].astype(int)  # less the corners, which have 7 % of the light
    assert np.ptp(evened.mean(axis=2)) < 25  # of 200, with noise of 2 levels divided by 0.3
    notes = json.loads((folder / "report.json").read_text())["notes"]
    assert not [note for note in notes if "no white picture" in note]


def test_python_takes_the_same(folder):
    options = {"lens_pitch": 9.3, "lens_offset": (4.2, 5.1), "lens_rotation": 0.5, "lens_grid": "square"}
    light_field = ciir.open("raw.png", **options, pixels=(5, 5), white="white.png", show_grid="grid.png")
    assert light_field.views.shape[:2] == (5, 5)
    assert (folder / "grid.png").exists()


def test_an_array_takes_the_same(folder):
    np.save("raw.npy", decode((folder / "raw.png").read_bytes(), name="raw"))
    options = {"lens_pitch": "auto", "pixels": (5, 5), "white": "white.png"}
    found = ciir.open("raw.npy", **options, show_grid="grid.png")
    assert np.array_equal(found.views, ciir.open("raw.png", **options).views)
    assert (folder / "grid.png").exists()
    assert inspect(open_source("raw.npy"), Options(lens_pitch="auto"))["kind"] == "raw"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["scene:vase", "--lens-pitch", "auto"],
            "--lens-pitch: this is for raw lenslet pictures, unlike scene:vase",
        ),
        (["raw.png", *GRID, "--white", "white.npy"], "white: white.npy is not a picture; give one as large as the raw"),
        (["scene:vase", "--white", "white.png"], "white: frames go with one raw lenslet picture"),
        (["cube.off", "--show-grid", "grid.png"], "--show-grid: this is for a raw lenslet picture"),
        (["raw.png", *GRID, "--show-grid", "grid.jpg"], "--show-grid: 'grid.jpg' doesn't end with .png"),
        (["raw.png", *GRID, "--show-grid", "raw.png"], "raw.png: the input is there"),
        (["raw.png", *GRID, "--dark", "gone.png"], "gone.png: No such file"),
        (["raw.png", "--white", "white.png"], "--lens-pitch: raw.png holds a picture with white or dark frames"),
        (["raw.png"], "give --lens-pitch auto for a raw lenslet picture"),
    ],
)
def test_what_does_not_fit_is_one_line(folder, capsys, words, message):
    (folder / "cube.off").write_bytes(CUBE)
    assert main(["reconstruct", *words, "-o", "out"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
