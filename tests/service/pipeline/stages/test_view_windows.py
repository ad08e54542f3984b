"""Windows of views that are rendered around those of a mesh: where the views lie, and what they gain."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.models.light_field.disparities.ranges import estimate_tiles
from ciir.models.light_field.disparities.shifts import crop_luma
from ciir.models.light_field.strides import MOVED
from ciir.models.light_field.windows import list_window
from ciir.renderer.backends.embree import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.placement import Placement
from ciir.renderer.scene import Window
from ciir.renderer.scenes import load_scene
from ciir.service.pipeline import job
from ciir.service.pipeline.stages.view_windows import LEAST, ViewWindows, find_view_windows
from tests.support.pipeline import run


def find_windows(mesh, array, placement):
    return find_view_windows(mesh, array, placement, frame_scene(mesh, array, placement))


COUNTS = st.integers(1, 20)


@settings(max_examples=60)
@given(counts=st.tuples(COUNTS, COUNTS), spacing=st.floats(LEAST, 4), share=st.tuples(st.floats(0, 1), st.floats(0, 1)))
def test_views_of_the_array_keep_their_directions_in_the_middle_of_a_window(counts, spacing, share):
    array, windows = LensArray(4, 4, *counts, delta=0.02), ViewWindows(spacing)
    refined = windows.refine(array)
    assert (refined.pixels_v, refined.pixels_u) == windows.list_grid(counts)
    v, u = (min(int(part * count), count - 1) for part, count in zip(share, counts, strict=True))
    window = list_window(windows.find_place((v, u)), windows.list_grid(counts))
    assert [offset for _, offset in window] == [(row, column) for row in range(-2, 3) for column in range(-2, 3)]
    tx, ty = array.tangent_x()[u], array.tangent_y()[v]
    for (row, column), (down, right) in window:
        assert refined.tangent_x()[column] == pytest.approx(tx + right * spacing * 0.02, abs=1e-12)
        assert refined.tangent_y()[row] == pytest.approx(ty - down * spacing * 0.02, abs=1e-12)


@pytest.mark.parametrize("lenses", [10, 25, 50, 100, 200, 400])
@pytest.mark.parametrize("place", [-1.0, 0.0, 1.0])
def test_the_farthest_content_moves_by_what_is_best_within_the_range_of_the_array(lenses, place):
    mesh, array = load_scene("vase"), LensArray(lenses, lenses, 15, 15)
    spacing = find_windows(mesh, array, Placement(place=place)).spacing
    depth = np.abs(mesh.transform(frame_scene(mesh, array, Placement(place=place))).bounds()[:, 2]).max()
    own = depth * array.delta / array.pitch
    assert own * spacing == pytest.approx(min(3.5 * own, MOVED))  # 3.5: four steps reach from one side to the other


def test_a_shallow_object_has_the_whole_range():
    mesh = load_scene("vase")
    flat = mesh.transform(np.diag([1.0, 1.0, 0.0, 1.0]))
    for pixels, spacing in (((15, 15), 3.5), ((9, 15), 2.0), ((3, 3), 1.0)):
        found = find_windows(flat, LensArray(50, 50, *pixels), Placement(place=0.0))
        assert (found.spacing, found.disparities) == (spacing, (0.0, 0.0))


@pytest.mark.parametrize("place", [-1.0, 0.0, 1.0])
def test_disparities_are_those_of_the_nearest_and_the_farthest_side(place):
    """As they are measured in the views; outlines, which are rendered as steps, seem to move by more."""
    mesh, array, placement = load_scene("globe"), LensArray(64, 64, 9, 9), Placement(place=place)
    matrix = frame_scene(mesh, array, placement)
    windows = find_view_windows(mesh, array, placement, matrix)
    low, high = windows.disparities
    near, far = mesh.transform(matrix).bounds()[::-1, 2] * array.delta / array.pitch * windows.spacing
    assert (low, high) == pytest.approx((far, near))
    grid, at = windows.list_grid((9, 9)), windows.find_place((4, 1))
    views = [view for view, _ in list_window(at, grid)]
    made = RaytraceBackend().render_views(mesh.transform(matrix), windows.refine(array), views, samples=4)
    lumas = {view: crop_luma(picture[..., :3]) for view, picture in zip(views, made, strict=True)}
    tiles = np.indices((8, 8)).reshape(2, -1)
    (found,) = estimate_tiles(lumas, [at], grid, tiles, [np.zeros(64, int)])
    assert len(found) > 10
    assert np.mean((found > low - 0.05) & (found < high + 0.05)) > 0.8


def test_the_views_of_the_array_help_where_what_is_seen_is_not_known():
    mesh, array = load_scene("vase"), LensArray(200, 200, 15, 15)
    assert find_windows(mesh, array, Placement()).spacing == pytest.approx(0.23, abs=0.01)
    assert find_windows(mesh, array, Placement(fit="none")) is None
    window = Window(nearest=1.0, distance=2.0, farthest=3.0, half_height=1.0, half_width=None)
    assert find_windows(replace(mesh, window=window), array, Placement()) is None
    wide = LensArray(200, 200, 3, 60_000, delta=0.03)
    assert find_windows(mesh, wide, Placement()) is None  # more directions than an array may have


def test_they_bring_a_view_closer_to_the_truth():
    """By 2.4 dB here (docs/experiments.md): the lens array's own see around the vase."""
    options = {"lenses": (100, 100), "backend": "raytrace", "model": "field"}
    truth, _ = run("vase", **options | {"model": "auto", "strategy": "direct"})
    errors = []
    for bound, words in (
        (0.0, "views around those asked for are rendered too, 24"),
        (60.0, "24 more, 0.46 times as far apart"),
    ):
        views, report = run("vase", **options, neighbour_time=bound)
        assert words in report["plan"]["reasons"][0]
        errors.append(np.square(views[7, 7].astype(float) - truth[7, 7]).mean())
    assert errors[1] < 0.75 * errors[0]


def test_a_view_does_not_depend_on_the_others_that_are_wanted():
    options = {"lenses": (60, 60), "pixels": (5, 5), "backend": "raytrace", "model": "field", "neighbour_time": 60.0}
    several, report = run("vase", **options, views="0,0;2,2;4,1")
    assert [(view["v"], view["u"]) for view in report["views"]] == list(several) == [(0, 0), (2, 2), (4, 1)]
    for view, picture in several.items():
        alone, _ = run("vase", **options, views="{},{}".format(*view))
        np.testing.assert_array_equal(alone[view], picture)


def test_the_mesh_is_framed_once(monkeypatch):
    framed = []
    monkeypatch.setattr(job, "frame_scene", lambda *given: framed.append(given) or frame_scene(*given))
    _, report = run("vase", lenses=(12, 10), model="field", backend="raytrace")
    assert any("are rendered around" in reason for reason in report["plan"]["reasons"])
    assert len(framed) == 1
