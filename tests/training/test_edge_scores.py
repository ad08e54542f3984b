"""What an edge score is learnt to stand for."""

import json

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import numpy as np
from PIL import Image

from models import bounded, catalogue, cells
from models.baselines import Bicubic
from training import edge_scores


def picture(seed, height, width):
    """Waves, 8-bit RGB."""
    phase = np.random.default_rng(seed).random((3, 3)) * 6
    y, x = np.mgrid[:height, :width]
    waves = [np.sin(y / 5 + a) + np.sin(x / 7 + b) + np.sin((x + y) / 4 + c) for a, b, c in phase]
    return (127.5 + 40 * np.stack(waves, axis=2)).clip(0, 255).round().astype(np.uint8)


class Brighter(Bicubic):
    """Interpolation, three levels brighter."""

    def __call__(self, images):
        return super().__call__(images) + np.float32(3 / 255)


def law(factor, *, count=4000, seed=0):
    """Cells whose error is a multiple of their score, 0 to 2 times that, evenly."""
    random = np.random.default_rng(seed)
    scores = 2.0 ** random.uniform(2, 12, count)
    return edge_scores.Cells(scores, factor * scores * random.uniform(0, 2, count))


def test_the_error_of_a_score_is_a_quantile():
    scores, errors = np.array(edge_scores.table({"photograph": law(0.1)})).T
    assert (scores == 2.0 ** np.arange(2, 13)).all()
    inner = slice(1, -1)  # half of the first and last range is empty
    want = 0.2 * edge_scores.QUANTILE * scores[inner]
    assert np.abs(errors[inner] / want - 1).max() < 0.15  # the quantile is of a range that doubles


def test_of_several_kinds_the_worst_counts():
    worst = edge_scores.table({"pinhole": law(0.3, seed=1)})
    assert edge_scores.table({"photograph": law(0.1), "pinhole": law(0.3, seed=1)}) == worst


def test_errors_never_fall():
    random = np.random.default_rng(0)
    cells = edge_scores.Cells(2.0 ** random.uniform(2, 12, 4000), random.exponential(1, 4000))
    assert (np.diff([error for _, error in edge_scores.table({"photograph": cells})]) >= 0).all()


def test_too_few_cells():
    with pytest.raises(ValueError, match="give more"):
        edge_scores.table({"photograph": law(0.1, count=20)})


def test_errors_of_cells():
    some = picture(1, 21, 18)
    assert (edge_scores.cell_errors(Bicubic(2), some) == 0).all()
    errors = edge_scores.cell_errors(Brighter(2), some)
    assert errors.shape == cells.edge_scores(some).shape == (3, 3)
    assert np.allclose(errors, 9)


def test_a_window_sees_no_more_than_the_radius():
    assert edge_scores.around(Bicubic(2), [picture(1, 60, 60)]) == Bicubic(2).radius


def test_the_file_is_what_the_models_read(tmp_path, monkeypatch):
    monkeypatch.setattr(edge_scores, "SCENES", 1)
    monkeypatch.setattr(edge_scores, "FEWEST", 4)
    (tmp_path / "photographs").mkdir()
    for seed in range(3):
        Image.fromarray(picture(seed, 120, 128)).save(tmp_path / "photographs" / f"{seed}.png")
    entry = next(entry for entry in catalogue.entries() if entry.name == "fast")
    monkeypatch.setattr(catalogue, "entries", lambda: [entry])
    out = tmp_path / "tables.json"
    assert edge_scores.main(["--pictures", str(tmp_path / "photographs"), "--out", str(out)]) == 0
    assert "photographs" in json.loads(out.read_text())["learnt_on"]
    monkeypatch.setattr(bounded, "TABLES", out)
    bounded.tables.cache_clear()
    try:
        table = bounded.table_of(catalogue.load("fast"))
    finally:
        bounded.tables.cache_clear()
    assert len(table.scores) == len(table.errors) > 1
