"""The promise of `--max-error` on the shipped scenes, against the network and against the truth."""

import numpy as np
import pytest

from benchmarks import bounded
from models import catalogue
from models.baselines import Bicubic
from renderer.scenes import SCENES


@pytest.mark.parametrize("lenses", [50, 100])
@pytest.mark.parametrize("sampling", ["pinhole", "lenslet"])
def test_the_bound_holds_on_every_scene(sampling, lenses):
    model = catalogue.load("fast")
    some = [one for name in SCENES for one in bounded.of_scene(name, lenses, sampling, wanted="center")]
    rows = [bounded.measure(model, some, bound, rounds=0) for bound in bounded.BOUNDS]
    assert all(row.holds for row in rows)
    shares = [row.interpolated for row in rows]
    assert shares == sorted(shares)
    assert shares[-1] > 0.2 if lenses > 64 else shares[-1] == 0  # small ones go whole


def test_a_broken_promise_shows(monkeypatch):
    """A table that says that interpolation costs nothing."""
    table = bounded.tables.Table(np.array([1.0, 1e9]), np.array([1e-6, 1e-6]), 4)
    monkeypatch.setattr(bounded.tables, "table_of", lambda model: table)
    some = bounded.of_scene("globe", 100, "pinhole", wanted="center")
    row = bounded.measure(catalogue.load("fast"), some, 0.5, rounds=0)
    assert row.interpolated == 1
    assert not row.holds
    assert row.change < 0


def test_interpolation_itself_differs_by_nothing():
    some = [bounded.Seen(np.random.default_rng(0).integers(0, 255, (20, 30, 3), np.uint8), None)]
    row = bounded.measure(Bicubic(2), some, 1.0, rounds=1)
    assert row.worst == row.interpolated == 0
    assert np.isnan(row.growth)
    assert row.holds
    assert row.faster > 0
