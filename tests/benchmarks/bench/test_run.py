import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from ciir.benchmarks.bench import arrays
from ciir.benchmarks.bench.run import Asked, bench, quick
from ciir.models import catalogue
from ciir.renderer.writers.pictures import encode_png
from ciir.service.cli.main import main

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("bench")
    asked = Asked(sources={"vase": "vase"}, places={"vase": "scene:vase"}, lenses=(24,), rounds=1, extras=False)
    return bench(asked, out), out


def test_every_method_has_a_row_and_a_place_in_the_tables(done):
    found, out = done
    rows = list(csv.DictReader((out / "results.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(found["rows"]) == 2 * len({row["method"] for row in rows})
    text = (out / "results.md").read_text(encoding="utf-8")
    default = catalogue.default_name()
    for name in ("nearest", "fast", f"{default}-whole", "paper", "direct-raster", "direct-rays"):
        assert sum(line.startswith(f"| `{name}`") for line in text.splitlines()) == 3  # two samplings, own process
    assert all(row["ms_median"] for row in rows if not row["fault"])
    assert (out / "pareto.png").stat().st_size > 5000
    assert (out / "crops.png").stat().st_size > 5000


def test_json_holds_the_same_and_is_strict(done):
    found, out = done
    again = json.loads((out / "results.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    exact = [row for row in again["rows"] if row["method"] == "direct-rays"]
    assert {row["psnr_all"] for row in exact} == {"inf"}
    assert again["machine"]["cores"] >= 1
    assert set(again["frontier"]) == {"24 lenses, pinhole", "24 lenses, lenslet"}
    assert math.isfinite(found["seconds"])


def test_rows_say_what_rendered_them(done):
    """`auto` casts so few rays; only what asks for OpenGL by name gets it."""
    assert {(row["method"] == "direct-raster", row["backend"]) for row in done[0]["rows"]} == {
        (True, "raster"), (False, "raytrace"),
    }  # fmt: skip


def test_the_paper_is_the_unit_of_the_ratios(done):
    rows = done[0]["rows"]
    assert {row["times_faster_than_paper"] for row in rows if row["method"] == "paper"} == {1.0}


def test_other_processes_have_times_and_memory(done):
    (of,) = done[0]["alone"].values()
    for name, got in of.items():
        assert not isinstance(got, str), f"{name}: {got}"
        assert got["cold_ms"] > 100  # an interpreter and numpy
        assert got["peak_mib"] is None or got["peak_mib"] > 20


def test_arrays_engines_and_growth_are_measured_too(tmp_path):
    """`--quick` as it is, with one round."""
    found = bench(replace(quick(), rounds=1), tmp_path)
    routes = {route["name"]: route["differ"] for route in found["arrays"]}
    assert routes[arrays.RAYS] == 0
    assert max(routes.values()) < 0.01  # edges alone: OpenGL's rounding of which side a ray passes
    engines = {row["engine"] for row in found["engines"]}
    assert {"fast: onnxruntime", "paper: onnxruntime"} <= engines
    assert all(row["differs"] < 0.01 for row in found["engines"] if "torch" in row["engine"])
    assert {line["over"] for line in found["growth"]} == {
        "lenses along a side", "pixels along a side of an elemental image", "triangles", "views", "threads",
    }  # fmt: skip
    assert (tmp_path / "growth.png").stat().st_size > 5000


def test_an_eia_from_the_command_line(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (36, 36, 3), dtype=np.uint8)
    (tmp_path / "eia.png").write_bytes(encode_png(picture))
    out = tmp_path / "out"
    arguments = ["bench", str(tmp_path / "eia.png"), "--pixels", "3x3", "--rounds", "1", "--only-views", "-o", str(out)]
    assert main(arguments) == 0
    rows = list(csv.DictReader((out / "results.csv").read_text(encoding="utf-8").splitlines()))
    assert {row["lenses"] for row in rows} == {"3x3", "6x6"}  # half of 12x12, and half of the half for pinholes
    assert "direct-rays" not in {row["method"] for row in rows}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["scene:vases"], "scene:vases: no such scene"),
        (["--lenses", "0"], "--lenses: '0' is no whole number from 2"),
        (["--rounds", "many"], "--rounds: 'many'"),
        (["scene:vase", "scene:vase"], "two inputs have the same name"),
        (["-o", "x.png"], "can't be written as .png"),
        (["gone.glb"], "gone.glb"),
    ],
)
def test_faults_are_one_line(arguments, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
