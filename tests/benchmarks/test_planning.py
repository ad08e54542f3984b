import pytest

from ciir.benchmarks import planning
from ciir.renderer.readers.bundle import Bundle
from ciir.service.pipeline.planning import cost


def row(**changes):
    rounds = {"upscale": [10.0, 20.0, 11.0], "direct": [30.0, 60.0, 33.0], "auto": [11.0, 22.0, 30.0]}
    best = {strategy: min(times) for strategy, times in rounds.items()}
    return {
        "mesh": "vase", "lenses": 25, "sampling": "pinhole", "views": "all", "took": "upscale", "predicted": 9.0,
        "rounds": rounds,
    } | best | changes  # fmt: skip


def test_strategies_are_compared_within_rounds():
    assert planning.compute_slowdown(row()) == pytest.approx(0.1)
    assert not planning.format_row(row()).endswith("!")
    assert planning.compute_slowdown(row(upscale=100.0)) == pytest.approx(11 / 30 - 1)
    late = row()
    late["rounds"]["auto"] = [12.0, 24.0, 11.0]
    assert planning.format_row(late).endswith("20 % !")


def test_a_row_is_measured(monkeypatch, tmp_path):
    mesh = tmp_path / "a.off"
    mesh.write_text("OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n")
    monkeypatch.setattr(cost, "costs", lambda *, measure=True: cost.Costs(None))
    monkeypatch.setattr(cost, "_factor", lambda backend: 1.0)
    monkeypatch.setattr(cost, "measure", lambda run: 1.0)
    options = {"lenses": (6, 6), "pixels": (3, 3), "model": "bicubic", "backend": "raytrace"}
    found = planning.measure(Bundle.from_path(mesh), options, 1)
    assert found["took"] == "upscale"  # 36 rays against 2,304
    assert 0 < found["predicted"] < 20
    assert all(len(times) == 1 for times in found["rounds"].values())
