"""How views are cut into batches of rays, and on all cores."""

import threading

import numpy as np
import pytest

from ciir.renderer.backends import raytrace
from ciir.renderer.backends.embree import PreparedScene
from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.lens_array import LensArray
from tests.renderer.backends.test_embree import ARRAY, triangles


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("at_once", [50, 1 << 16])
def test_one_ray_is_cast_for_each_sample(samples, at_once, monkeypatch):
    """Of each lens in each of the views, and no others, for any size of batch."""
    array, views, batches = LensArray(7, 9, 2, 3, pitch=0.5, delta=0.1), [(0, 0), (1, 2)], []
    cast = PreparedScene.cast_levels

    def counted(prepared, origins, direction):
        batches.append(len(origins))
        return cast(prepared, origins, direction)

    monkeypatch.setattr(PreparedScene, "cast_levels", counted)
    monkeypatch.setattr(raytrace, "RAYS_PER_BATCH", at_once)
    assert len(list(RaytraceBackend().render_views(triangles(), array, views, samples=samples))) == len(views)
    a_view = 7 * 9 * samples**2
    assert sum(batches) == len(views) * a_view
    rows_at_once = max(1, at_once // (9 * samples))
    assert len(batches) == (1 if len(views) * a_view <= at_once else len(views) * -(-7 * samples // rows_at_once))
    batches.clear()
    RaytraceBackend().render_eia(triangles(), array, samples=samples)
    assert sum(batches) == 2 * 3 * a_view


def test_the_next_views_are_cast_while_one_is_used(monkeypatch):
    """Two views, each in a group of its own: the second is cast before it is asked for."""
    cast, done = PreparedScene.cast_levels, []
    second = threading.Event()

    def counted(prepared, origins, direction):
        done.append(direction)
        if len(done) == 2:
            second.set()
        return cast(prepared, origins, direction)

    monkeypatch.setattr(PreparedScene, "cast_levels", counted)
    monkeypatch.setattr(raytrace, "RAYS_AT_ONCE", 1)
    array = LensArray(7, 9, 2, 3, pitch=0.5, delta=0.1)
    pictures = RaytraceBackend().render_views(triangles(), array, [(0, 0), (1, 2), (0, 1)])
    next(pictures)
    assert second.wait(60)
    assert len(list(pictures)) == 2


@pytest.mark.parametrize("at_once", [1, 130, 1 << 18])  # 63 rays a view: one view, two, all
@pytest.mark.parametrize("batch", [20, 130, 1 << 14])
def test_views_are_the_same_and_in_order_whatever_is_cast_together(at_once, batch, monkeypatch):
    array, views = LensArray(7, 9, 2, 3, pitch=0.5, delta=0.1), [(1, 2), (0, 0), (1, 0), (0, 2), (0, 1)]
    singly = [next(RaytraceBackend().render_views(triangles(), array, [view])) for view in views]
    monkeypatch.setattr(raytrace, "RAYS_AT_ONCE", at_once)
    monkeypatch.setattr(raytrace, "RAYS_PER_BATCH", batch)
    np.testing.assert_array_equal(list(RaytraceBackend().render_views(triangles(), array, views)), singly)


def test_an_error_of_a_thread_is_raised(monkeypatch):
    def fail(prepared, origins, direction):
        raise MemoryError

    monkeypatch.setattr(PreparedScene, "cast_levels", fail)
    with pytest.raises(MemoryError):
        list(RaytraceBackend().render_views(triangles(), ARRAY, [(0, 0)]))
