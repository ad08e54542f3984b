import csv
import json

import numpy as np
import pytest

from ciir.benchmarks.bench.methods import QUICK
from ciir.benchmarks.bench.run import BenchOptions, bench
from ciir.models import catalogue
from ciir.renderer.writers.pictures import encode_png
from ciir.service.cli.main import main

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")


def test_every_method_has_a_row_in_each_result(tmp_path):
    found = bench(BenchOptions(sources={"vase": "vase"}, lenses=(24,), rounds=1), tmp_path)
    rows = list(csv.DictReader((tmp_path / "results.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(found["rows"]) == 2 * len({row["method"] for row in rows})
    text = (tmp_path / "results.md").read_text(encoding="utf-8")
    for name in ("nearest", "fast", f"{catalogue.prefer_int8(QUICK)}-whole", "paper", "direct-raster", "direct-rays"):
        assert sum(line.startswith(f"| `{name}`") for line in text.splitlines()) == 2  # two samplings
    assert all(row["ms_median"] for row in rows if not row["error"])
    assert {row["times_faster_than_paper"] for row in rows if row["method"] == "paper"} == {"1.0"}
    assert {row["backend"] for row in rows if row["method"] != "direct-raster"} == {"raytrace"}  # `auto`, so few rays
    for name in ("pareto.png", "crops.png"):
        assert (tmp_path / name).stat().st_size > 5000
    again = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert {row["psnr_all"] for row in again["rows"] if row["method"] == "direct-rays"} == {"inf"}
    assert set(again["frontier"]) == {"24x24 lenses, pinhole", "24x24 lenses, lenslet"}


def test_an_eia_from_the_command_line(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (36, 36, 3), dtype=np.uint8)
    (tmp_path / "eia.png").write_bytes(encode_png(picture))
    out = tmp_path / "out"
    assert main(["bench", str(tmp_path / "eia.png"), "--pixels", "3x3", "--rounds", "1", "-o", str(out)]) == 0
    rows = list(csv.DictReader((out / "results.csv").read_text(encoding="utf-8").splitlines()))
    assert {row["lenses"] for row in rows} == {"3x3", "6x6"}  # half of 12x12, and half of the half for pinholes
    assert "direct-rays" not in {row["method"] for row in rows}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["scene:vases"], "scene:vases: no such scene"),
        (["--lenses", "0"], "--lenses: '0' is not a whole number from 2"),
        (["--rounds", "many"], "--rounds: 'many'"),
        (["scene:vase", "scene:vase"], "two inputs have the same name"),
        (["-o", "x.png"], "can't be written as .png"),
        (["gone.glb"], "gone.glb"),
    ],
)
def test_errors_are_one_line(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
