"""The benchmark of all networks at an equal budget, on networks of a few weights and pictures of a few pixels."""

# ruff: noqa: E402 - imports follow the skip for where torch is absent

import json
from dataclasses import asdict

import pytest

NEEDS = "needs the training extra"
pytest.importorskip("torch", reason=NEEDS)
pytest.importorskip("onnxscript", reason=NEEDS)
import numpy as np
from PIL import Image

from ciir.benchmarks import peers
from ciir.benchmarks.bench.timing import Times
from ciir.models.cards import Accuracy
from ciir.training.networks import make_network

TINY = {
    "lite-6": peers.Peer("lite", "lite", {"blocks": 1, "channels": 4, "batch_norm": True}),
    "rdn": peers.Peer("RDN", "rdn", {"blocks": 1, "layers": 1, "growth": 4, "base": 4}, large=True),
}


@pytest.fixture
def data(tmp_path):
    """A folder as `--data` names it: training pictures and one pair for each test set."""
    random = np.random.default_rng(0)
    for name in ("train", *peers.SETS):
        (tmp_path / "data" / name).mkdir(parents=True)
        low = random.integers(0, 256, (16, 16, 3), dtype=np.uint8)
        high = Image.fromarray(low.repeat(2, axis=0).repeat(2, axis=1))
        high.save(tmp_path / "data" / name / ("a.png" if name == "train" else "a_HR.png"))
        if name != "train":
            Image.fromarray(low).save(tmp_path / "data" / name / "a_LR.png")
    return tmp_path / "data"


@pytest.fixture
def tiny(monkeypatch):
    monkeypatch.setattr(peers, "PEERS", TINY)
    monkeypatch.setattr(peers, "VIEW", 8)
    monkeypatch.setattr(peers, "TABLE_2", ("lite-6",))
    monkeypatch.setattr(peers, "TABLE_3", ("bicubic", "rdn", "lite-6"))
    monkeypatch.setattr(peers.torch.cuda, "is_available", lambda: False)


def command(data, out, *more):
    budget = ["--updates", "2", "--crop", "16", "--batch", "2", "--rounds", "2"]
    return [*budget, "--data", str(data), "--out", str(out), *more]


def no_time(names, rounds):
    return {name: Times(1.0, 1.0, 1.0, {}) for name in names}


def test_a_second_run_trains_nothing_again(tiny, data, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    assert peers.main(command(data, out)) == 0
    text = (out / "tables.md").read_text()
    assert text == capsys.readouterr().out
    lines = {line.split(" | ")[0].strip("| "): line.split(" | ") for line in text.splitlines() if line.startswith("|")}
    assert lines["RDN"][1:5] == ["not trained", "-", "-", "-"]
    assert float(lines["RDN"][5]) > 0  # seconds per update, though it was not trained
    assert lines["bicubic interpolation"][1] == "-"
    assert lines["lite"][1] == "2"
    assert lines["lite"][6] == "1.00"
    found = json.loads((out / "figures.json").read_text())
    assert found["recipe"]["steps"] == 2
    assert found["machine"]["cores"] >= 1
    assert [score["data"] for score in found["networks"]["lite-6"]["accuracy"]] == list(peers.SETS)
    assert not (out / "rdn").exists()
    assert (out / "lite-6" / "lite-6.onnx").exists()

    monkeypatch.setattr(peers, "time_views", no_time)
    written = {path: path.stat().st_mtime_ns for path in out.glob("*/*")}
    assert peers.main(command(data, out, "--only", "lite-6")) == 0
    assert {path: path.stat().st_mtime_ns for path in out.glob("*/*")} == written


def test_a_large_network_is_trained_where_it_is_asked_for(tiny, data, tmp_path, monkeypatch):
    monkeypatch.setattr(peers, "time_views", no_time)
    out = tmp_path / "out"
    assert peers.main(command(data, out, "--only", "rdn", "--all")) == 0
    row = json.loads((out / "figures.json").read_text())["networks"]["rdn"]
    assert row["updates"] == 2
    assert len(row["accuracy"]) == 3


def test_all_have_one_budget():
    recipes = [
        asdict(peers.make_recipe(name, updates=9, crop=48, batch=4, data=peers.Path("x"))) for name in peers.PEERS
    ]
    same = [{key: r[key] for key in r if key not in ("name", "network", "options")} for r in recipes]
    assert all(other == same[0] for other in same)
    for each in recipes:
        assert make_network(each["network"], each["options"]).scale == each["scale"]


@pytest.mark.parametrize(("name", "published"), [("srcnn", 63.8), ("lite-6", 146.4), ("fsrcnn", 5.6)])
def test_multiply_adds(name, published):
    """By hand: weights of the layers at the output's size, and a quarter of those at the input's."""
    by_hand = {
        "srcnn": 9 * 9 * 3 * 64 + 5 * 5 * 64 * 32 + 5 * 5 * 32 * 3,
        "lite-6": (3 * 64 * 9 + 13 * 64 * 64 * 9) / 4 + 64 * 64 * 9 + 64 * 3 * 9,
        # A deconvolution multiplies each of its inputs with each of its weights.
        "fsrcnn": (5 * 5 * 3 * 56 + 56 * 12 + 4 * 9 * 12 * 12 + 12 * 56 + 9 * 9 * 56 * 3) / 4,
    }[name]
    got = peers.describe_network(name, (), 0).multiply_adds
    assert got == pytest.approx(by_hand * 1280 * 720 / 1e9, rel=1e-3)  # an interpolated base is under a thousandth
    assert got == pytest.approx(published, abs=0.1)


def test_a_row():
    scores = tuple(Accuracy(name, 1, 30.126, 0.91239) for name in peers.SETS)
    row = peers.Figures("X", scores, 1500, 12345, 1.25, 3.0, 0.1234, 1.0)
    cells = "| X | 1500 | 30.13 / 0.9124 | 30.13 / 0.9124 | 30.13 / 0.9124 | 0.123 | 1.00 | 12,345 | 1.2 | 3.0 |"
    assert peers.format_rows([row]).splitlines()[2] == cells
    assert peers.format_rows([peers.Figures("Y")]).splitlines()[2] == "| Y |" + " - |" * 9
