import json

import numpy as np
import pytest

from ciir.benchmarks.harm import light_fields, pictures, run
from ciir.renderer.writers.pictures import encode_png
from ciir.service.cli.main import main
from tests.support.inputs import CUBE, make_picture
from tests.support.networks import install_stand_in

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")

DRAWN = ("drawn globe", "drawn text")
"""The pictures that are drawn if none is given."""
SMALL = ["bench", "--harm", "--quick", "--lenses", "12"]


def run_harm(out, *arguments):
    """The exit status, and what the JSON file holds."""
    try:
        status = main([*SMALL, "-o", str(out), *map(str, arguments)])
    except SystemExit as end:
        status = end.code
    return status, json.loads((out / "harm.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)


def test_the_default_over_all_kinds(tmp_path, capsys):
    status, found = run_harm(tmp_path)
    assert status == (found["over"] > 0)  # today's networks may pass or not
    rows = found["rows"]
    counts = len(light_fields.list_variations((5, 5), quick=True)), len(pictures.list_variations(quick=True))
    assert len(rows) == found["cases"] == 2 * 4 + counts[0] + 2 * counts[1]
    assert {row["input"] for row in rows} == {"vase", "grey chair", light_fields.DRAWN, *DRAWN}
    margins = [min(m for m in (row["against_bicubic"], row["against_single"]) if m is not None) for row in rows]
    assert margins == sorted(margins)
    assert found["over"] == sum(row["is_over"] for row in rows) == sum(margin < -found["bound"] for margin in margins)
    assert all(set(row["psnr"]) == set(row["ssim"]) for row in rows)
    for row in rows:
        if row["kind"] == "picture":
            assert set(row["psnr"]) == {"bicubic", "default"}
            assert row["against_single"] is None
        else:
            assert {"bicubic", "default", "fast", row["model"]} <= set(row["psnr"])
    text = (tmp_path / "harm.md").read_text(encoding="utf-8")
    assert all(row["case"] in text for row in rows)
    assert (tmp_path / "harm.png").stat().st_size > 20_000
    printed = capsys.readouterr().out
    assert f"{found['over']} of {found['cases']} cases are over the bound of 0.1 dB" in printed
    assert rows[0]["case"] in printed


@pytest.fixture
def without_figure(monkeypatch):
    """A figure takes longer than a few cases."""
    monkeypatch.setattr(run, "plot_harm", lambda rows, path, *, title: None)


@pytest.mark.usefixtures("without_figure")
def test_a_model_that_does_harm_ends_with_1(tmp_path):
    status, found = run_harm(tmp_path, "--model", "nearest", "--only", "light-fields")
    assert (status, found["judged"]) == (1, "nearest")
    assert {row["kind"] for row in found["rows"]} == {"light field"}
    assert {row["model"] for row in found["rows"]} == {"nearest"}


@pytest.mark.usefixtures("without_figure")
def test_a_model_that_does_none_ends_with_0(tmp_path):
    status, found = run_harm(tmp_path, "--model", "bicubic", "--only", "meshes")
    assert (status, found["over"]) == (0, 0)
    assert {row["kind"] for row in found["rows"]} == {"mesh"}
    assert {row["against_bicubic"] for row in found["rows"]} == {0}


@pytest.mark.usefixtures("without_figure")
def test_a_light_field_network_that_does_harm_ends_with_1(monkeypatch, tmp_path):
    stand_in = install_stand_in(monkeypatch)
    status, found = run_harm(tmp_path, "--only", "light-fields")
    assert status == 1
    assert {row["model"] for row in found["rows"]} == {stand_in.name}
    assert all(row["against_single"] is not None for row in found["rows"])
    assert found["rows"][0]["against_single"] < -found["bound"]


@pytest.mark.usefixtures("without_figure")
def test_inputs_are_measured_beside_those_that_ship(tmp_path):
    (tmp_path / "cube.off").write_bytes(CUBE)
    (tmp_path / "eia.png").write_bytes(encode_png(make_picture(3 * 40, 3 * 40)))
    folder = tmp_path / "views"
    folder.mkdir()
    for number in range(9):
        picture = make_picture(40, 36, seed=number)
        (folder / f"view_{number // 3:02d}_{number % 3:02d}.png").write_bytes(encode_png(picture))
    inputs = [tmp_path / "cube.off", tmp_path / "eia.png", folder, "scene:vase"]
    _, found = run_harm(tmp_path / "out", *inputs, "--lenses", "12", "40x40", "--model", "bicubic")
    assert {row["input"] for row in found["rows"]} == {"vase", "grey chair", "cube", "eia", "views", *DRAWN}
    jpeg = {row["factors"]["jpeg"] for row in found["rows"] if row["input"] == "eia"}
    assert jpeg == {"none", "75 interleaved"}
    assert {row["factors"]["grid"] for row in found["rows"] if row["input"] == "views"} == {"3x3"}


@pytest.mark.usefixtures("without_figure")
@pytest.mark.parametrize(("suffix", "only"), [("_HR", []), ("", ["--only", "pictures"])])
def test_photographs_are_measured_one_by_one(tmp_path, suffix, only):
    """A folder holds photographs if their names end with _HR, or if nothing else is wanted."""
    folder = tmp_path / "photographs"
    folder.mkdir()
    for number in range(2):
        (folder / f"{number}{suffix}.png").write_bytes(encode_png(make_picture(40, 36, seed=number)))
    _, found = run_harm(tmp_path / "out", folder, "--model", "nearest", *only)
    rows = [row for row in found["rows"] if row["kind"] == "picture"]
    assert len(rows) == 2 * len(pictures.list_variations(quick=True))
    names = {f"photographs/{number}{'' if suffix else '.png'}" for number in range(2)}
    assert {row["input"] for row in rows} == names
    assert {row["kind"] for row in found["rows"]} == ({"picture"} if only else {"mesh", "light field", "picture"})
    text = (tmp_path / "out" / "harm.md").read_text(encoding="utf-8")
    (line,) = [line for line in text.splitlines() if line.startswith("| box, noise 10 |")]
    margins = [row["against_bicubic"] for row in rows if row["case"].endswith("box, noise 10")]
    assert f"| 2 | {sum(row['is_over'] for row in rows if row['case'].endswith('box, noise 10'))} |" in line
    assert f"{min(margins):+.2f}, {sum(margins) / 2:+.2f}" in line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "meshes"], "--only: this is for the harm table"),
        (["--model", "fast"], "--model: this is for the harm table"),
        (["--harm", "--rounds", "3"], "--rounds: the harm table measures no times"),
        (["--harm", "--lenses", "5x5", "6x6"], "--lenses: 5x5 and 6x6"),
        (["--harm", "--lenses", "4"], "--lenses: '4' is not a whole number from 8"),
        (["--harm", "--model", "gpt"], "no 'gpt' here"),
        (["--harm", "--only", "cars"], "cars"),
        (["--harm", "vase.off"], "vase: this is the name of an input that ships"),
        (["--harm", "eia.png"], "give the number of lenses"),
    ],
)
def test_errors_are_one_line(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "vase.off").write_bytes(CUBE)
    (tmp_path / "eia.png").write_bytes(encode_png(np.zeros((9, 9, 3), np.uint8)))
    assert main(["bench", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
