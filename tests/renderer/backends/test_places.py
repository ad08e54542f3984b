"""Objects behind, astride and before the array: both backends agree, and parallax turns around at the array."""

from dataclasses import replace

import numpy as np
import pytest

from ciir.renderer.backends import culling
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.placement import Placement
from ciir.renderer.scene import Part, Scene
from tests.renderer.backends.test_culling import make_soup
from tests.support.backends import ARRAY, BACKENDS, find_disagreements, place_scene, require_backend

VIEWS = [(0, 0), (0, 14), (7, 7), (14, 3)]
TURNED = Placement(rotate=(30.0, -20.0, 10.0))


@pytest.mark.parametrize("place", [-0.4, 0.0, 1.0])
@pytest.mark.parametrize("name", ["hamburger", "globe", "milk-truck.glb"])
def test_raster_draws_what_rays_meet(name, place):
    raster, raytrace = map(require_backend, BACKENDS)
    placed = place_scene(name, placement=replace(TURNED, place=place))
    drawn, exact = (np.stack(list(b.render_views(placed, ARRAY, VIEWS))) for b in (raster, raytrace))
    assert exact[..., 3].any(axis=(1, 2)).all()
    assert find_disagreements(drawn, exact, textured=any(part.texture for part in placed.parts)) == []
    drawn, exact = (np.stack(list(b.render_depth(placed, ARRAY, VIEWS))) for b in (raster, raytrace))
    hit = np.isfinite(drawn) & np.isfinite(exact)
    assert (exact[hit] < 0).any() == (place > -1)
    # As `test_depths_agree`: float32 rounds to a few times 6e-8 of the longest side.
    longest = np.ptp(placed.bounds(), axis=0).max()
    error = np.abs(drawn[hit].astype(float) - exact[hit])
    assert np.median(error) < 1e-7 * longest
    assert (error < 2e-6 * longest).mean() > 0.99


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("array", [LensArray(12, 14, 9, 7), LensArray(4, 5, 16, 12)])  # fewer views; fewer lenses
def test_the_eia_holds_the_views_of_an_object_that_reaches_through_the_array(name, array):
    made = require_backend(name)
    placed = place_scene("hamburger", array, Placement(place=0.2))
    eia = made.render_eia(placed, array, background=(9, 8, 7))
    every = [(v, u) for v in range(array.pixels_v) for u in range(array.pixels_u)]
    for (v, u), view in zip(every, made.render_views(placed, array, every, background=(9, 8, 7)), strict=True):
        np.testing.assert_array_equal(eia[v :: array.pixels_v, u :: array.pixels_u], view)


def find_middle(made, scene, array, view):
    (picture,) = made.render_views(scene, array, [view])
    ys, xs = np.nonzero(picture[..., 3])
    return np.array([ys.mean(), xs.mean()])


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("distance", [12.0, 0.0, -12.0])
def test_parallax_turns_around_at_the_array(name, distance):
    """A point at distance d moves by -delta*d/pitch view pixels from one view to the next: before the array the other
    way. A flat sheet in the array's own plane does not move.
    """
    made, array = require_backend(name), replace(ARRAY, rows=200, cols=200, pitch=0.25)
    corners = np.array([[-5, -3, -distance], [5, -3, -distance], [5, 3, -distance], [-5, 3, -distance]], float)
    sheet = Scene((Part(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.ones((4, 4), np.float32)),))
    middle = find_middle(made, sheet, array, (7, 7))
    for v, u in VIEWS:
        step = array.delta * distance / array.pitch
        moved = find_middle(made, sheet, array, (v, u)) - middle
        np.testing.assert_allclose(moved, [-(v - 7) * step, -(u - 7) * step], atol=0.51)  # half a pixel at each edge
        (depth,) = made.render_depth(sheet, array, [(v, u)])
        np.testing.assert_allclose(depth[np.isfinite(depth)], distance, atol=2e-6 * 12)


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("away", [2.0, 6.0])
def test_culling_changes_nothing_astride_and_before_the_array(name, away):
    array, matrix = LensArray(7, 8, 5, 5, pitch=0.5, delta=0.1), np.eye(4)
    whole = make_soup(4, depth=0.0)  # z from about -6 to 0
    matrix[2, 3] = away
    whole = whole.transform(matrix)
    assert whole.bounds()[1, 2] > 0
    made, views = require_backend(name), [(0, 4), (2, 2)]
    culled = culling.cull_scene(whole, array, views)
    assert culled.triangles < whole.triangles / 2
    for found, expected in zip(*(made.render_views(s, array, views) for s in (culled, whole)), strict=True):
        assert expected[..., 3].any()
        np.testing.assert_array_equal(found, expected)


def test_see_through_parts_are_drawn_solid_by_opengl_with_a_note():
    raster, raytrace = map(require_backend, BACKENDS)
    from ciir.renderer.backends.raster import NOT_BLENDED

    corners = np.array([[-9, -9, -5], [9, -9, -5], [9, 9, -5], [-9, 9, -5]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    colors = np.tile(np.float32([1, 1, 1, 0.4]), (4, 1))
    near = Part(corners, faces, colors, is_see_through=True)
    far = Part(corners - [0, 0, 1], faces, colors + np.float32([0, -1, -1, 0.2]), is_see_through=True)
    array, scene = LensArray(6, 6, 3, 3), Scene((near, far))
    for render in (raster.render_views, raytrace.render_views):
        notes = set()
        (view,) = render(scene, array, [(0, 1)], notes=notes)
        if render == raster.render_views:
            assert (view == (255, 0, 0, 255)).all()
            assert notes == {NOT_BLENDED}
        else:
            # 0.4 white over 0.6 red over black
            assert np.abs(view[..., :3] - 255 * np.array([0.76, 0.4, 0.4])).max() <= 0.51
            assert notes == set()
    notes = set()
    raster.render_eia(scene, LensArray(2, 2, 5, 5), notes=notes)  # by lens
    assert notes == {NOT_BLENDED}
    for drawn, exact in zip(*(b.render_depth(scene, array, [(0, 1)]) for b in (raster, raytrace)), strict=True):
        np.testing.assert_allclose([drawn, exact], 6.0, rtol=1e-6)


def test_frames_of_all_places_hold_the_object():
    """The framing's own tests use points; here what is drawn touches no border."""
    raytrace = require_backend("raytrace")
    for place in (-1.0, 0.0, 0.7, 1.0):
        placed = place_scene("hamburger", placement=replace(TURNED, place=place))
        for view in raytrace.render_views(placed, ARRAY, VIEWS):
            is_shown = view[..., 3] > 0
            assert not is_shown[[0, -1]].any()
            assert not is_shown[:, [0, -1]].any()
            assert is_shown.any(axis=0).sum() > 25 or is_shown.any(axis=1).sum() > 25


def test_a_flat_sheet_in_the_arrays_plane_is_drawn():
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    sheet = Scene((Part(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.ones((4, 4), np.float32)),))
    for name in BACKENDS:
        made, placed = require_backend(name), sheet.transform(frame_scene(sheet, ARRAY, Placement(place=0.0)))
        (view,) = made.render_views(placed, ARRAY, [(3, 11)])
        assert (view[2:-2, 2:-2] == 255).all()
