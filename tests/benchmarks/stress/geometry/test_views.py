"""The cases on a small scene: they hold, say what could not run, and break where geometry does."""

import numpy as np
import pytest

from ciir.benchmarks.stress.case import Effort, Found, Skipped
from ciir.benchmarks.stress.geometry import agreement, surfaces, views
from ciir.errors import BackendUnavailable
from ciir.renderer.backends import open_backend
from ciir.renderer.surface import assemble_scene

QUICK = Effort(models=(), quick=True)


@pytest.fixture(autouse=True)
def ball(monkeypatch):
    """A ball of 500 triangles in the scenes' place."""
    monkeypatch.setattr(views, "load_scene", lambda name: assemble_scene([surfaces.make_ball(12)], name=name))
    monkeypatch.setattr(views, "SLOW", 20)


def ran(case):
    return list(case(QUICK))


@pytest.mark.parametrize("case", [views.framed, views.change_units, views.slivers])
def test_it_holds(case):
    found = ran(case)
    assert [one.what for one in found if isinstance(one, Found) and not one.holds] == []
    assert any("raytrace" in one.what for one in found)


def test_a_missing_opengl_is_reported(monkeypatch):
    def refused(name):
        if name == "raster":
            raise BackendUnavailable("raster: no display")
        return open_backend(name)

    monkeypatch.setattr(agreement, "open_backend", refused)
    found = ran(views.slivers)
    assert [one for one in found if isinstance(one, Skipped)] == [Skipped("needles: raster", "raster: no display")]
    assert all(one.holds for one in found if isinstance(one, Found))
    assert any(isinstance(one, Skipped) for one in ran(views.framed))


def test_a_picture_half_a_pixel_off_is_noticed(monkeypatch):
    exact = agreement.locate_samples
    monkeypatch.setattr(agreement, "locate_samples", lambda *given: exact(*given) + np.array([0.5, 0, 0]))
    assert any(not one.holds for one in ran(views.framed) if isinstance(one, Found))


def test_vertices_out_of_place_are_noticed(monkeypatch):
    from ciir.renderer.backends.embree import PreparedScene

    exact = PreparedScene._to_embree
    vertices = len(assemble_scene([surfaces.make_ball(12)], name="ball").parts[0].vertices)

    def rounded(self, points):
        placed = exact(self, points)
        return np.rint(placed) if len(points) == vertices else placed

    monkeypatch.setattr(PreparedScene, "_to_embree", rounded)
    assert any("raytrace against float64" in one.what for one in ran(views.framed) if not one.holds)
