"""The cases hold; and each breaks where what it watches is broken."""

import numpy as np
import pytest

from ciir.benchmarks.stress.case import Effort, Found
from ciir.benchmarks.stress.geometry import surfaces
from ciir.renderer import surface as checks
from ciir.renderer.backends import embree

QUICK = Effort(models=(), quick=True)


def broken(case):
    return [found.what for found in case(QUICK) if isinstance(found, Found) and not found.holds]


@pytest.mark.parametrize("case", surfaces.CASES, ids=lambda case: case.__name__)
def test_it_holds(case):
    assert broken(case) == []


def test_rays_that_stay_on_a_cut_out_are_noticed(monkeypatch):
    monkeypatch.setattr(embree, "STEP", 0.0)
    assert any(what.startswith("raytrace: 31 cut-outs") for what in broken(surfaces.cut_outs))


def test_a_hidden_sheet_that_shows_is_noticed(monkeypatch):
    monkeypatch.setattr(surfaces, "ORDERED", 2.0**-28)
    assert broken(surfaces.depth_order)


def test_seams_are_noticed(monkeypatch):
    whole = surfaces.shapes.make_mosaic

    def torn(*given, **named):
        (part,) = whole(*given, **named).parts
        part.faces[1640:1642] = part.faces[1642:1644]
        return surfaces.Scene((part,))

    monkeypatch.setattr(surfaces.shapes, "make_mosaic", torn)
    assert any("holes" in what for what in broken(surfaces.coplanar))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_numbers_that_are_none_are_noticed_when_let_through(monkeypatch):
    monkeypatch.setattr(checks.np, "isfinite", np.ones_like)
    monkeypatch.setattr(checks, "MAX_COORDINATE", np.inf)
    assert {"a vertex at nan, let through", "a vertex at -1e+12, let through"} <= set(broken(surfaces.degenerate))
