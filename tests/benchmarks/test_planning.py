import pytest

from ciir.benchmarks import planning
from ciir.renderer.readers.bundle import Bundle
from ciir.service.pipeline import cost


def row(**given):
    rounds = {"upscale": [10.0, 20.0, 11.0], "direct": [30.0, 60.0, 33.0], "auto": [11.0, 22.0, 30.0]}
    best = {strategy: min(times) for strategy, times in rounds.items()}
    return {
        "mesh": "vase", "lenses": 25, "sampling": "pinhole", "views": "all", "took": "upscale", "predicted": 9.0,
        "rounds": rounds,
    } | best | given  # fmt: skip


def test_rounds_are_compared_each_by_itself():
    assert planning.slower(row()) == pytest.approx(0.1)
    assert not planning.line(row()).endswith("!\n")
    assert planning.slower(row(upscale=100.0)) == pytest.approx(11 / 30 - 1)
    late = row()
    late["rounds"]["auto"] = [12.0, 24.0, 11.0]
    assert planning.line(late).endswith("20 % !\n")


def test_a_row_is_measured(monkeypatch, tmp_path):
    mesh = tmp_path / "a.off"
    mesh.write_text("OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n")
    monkeypatch.setattr(cost, "costs", lambda: cost.Costs(None))
    monkeypatch.setattr(cost, "_factor", lambda backend: 1.0)
    monkeypatch.setattr(cost, "measure", lambda run: 1.0)
    asked = {"lenses": (6, 6), "pixels": (3, 3), "model": "bicubic", "backend": "raytrace"}
    found = planning._measured(Bundle.from_path(mesh), asked, 1)
    assert found["took"] == "upscale"  # 36 rays against 2,304
    assert 0 < found["predicted"] < 20
    assert all(len(times) == 1 for times in found["rounds"].values())


def test_whole_processes_have_rows_without_a_prediction(monkeypatch):
    asked = []
    monkeypatch.setattr(planning, "whole_process", lambda options: asked.append(options) or len(asked))
    rows = list(planning._cold_rows([25], 2))
    assert [row["mesh"] for row in rows] == list(planning.SCENES)
    assert asked[0] == ["scene:vase", "--lenses", "25x25", "--strategy", "upscale"]
    assert rows[0]["rounds"] == {"upscale": [1, 4], "direct": [2, 5], "auto": [3, 6]}
    assert (rows[0]["upscale"], rows[0]["auto"], rows[0]["predicted"]) == (1, 3, None)
    assert "cold" in planning.line(rows[0])
