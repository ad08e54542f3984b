import math
import re
from dataclasses import replace

import numpy as np
import pytest

import ciir
from ciir.renderer.displays.depth_budget import (
    Frame,
    describe_light_field,
    describe_native,
    describe_row,
    find_shrinking,
    frame_integral,
    frame_screen,
    measure_integral,
    measure_lenticular,
    measure_quilt,
)
from ciir.renderer.displays.integral import IntegralDisplay
from ciir.renderer.displays.light_fields import order_as_cameras
from ciir.renderer.displays.screen import Screen, place_views
from ciir.renderer.scene import Part, Scene
from tests.support.displays import make_calibration
from tests.support.light_fields import make_views
from tests.support.paths import SHARED

ARRAY = SHARED / "data/lightfields/eia-200x200x15.jpg"
DISPLAY = IntegralDisplay(1000, 1000, 0.1, 1.0, 4.0)
"""Sharp to 1 mm / (0.1 / 4) = 40 mm."""


TEXTURELESS = "; the views have too little texture to measure theirs"


def make_sheets(*sheets):
    """A scene of squares `(z, x, side)` parallel to the display."""
    square = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    faces, colors = np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.ones((4, 4), np.float32)
    return Scene(tuple(Part(square * side + [x, 0, z], faces, colors) for z, x, side in sheets))


def test_what_lies_within_the_depth_of_field_is_sharp():
    budget = measure_integral(make_sheets((-39, 0, 10), (39, 0, 10)), DISPLAY)
    assert (budget.sharp, budget.nearest, budget.farthest) == pytest.approx((40, 39, -39))
    assert (budget.blurred, budget.cut) == (0, 0)
    (note,) = budget.notes()
    assert note.endswith(
        "sharp up to 40 mm behind and in front of its plane; the scene spans 39 mm behind it to 39 mm in front of it"
    )


def test_what_lies_beyond_it_blurs_by_its_share_of_the_surface():
    budget = measure_integral(make_sheets((-80, 0, 20), (0, 0, 20), (10, 0, 20), (50, 0, 20)), DISPLAY)
    assert budget.blurred == pytest.approx(0.5)
    with_less = "with depth_factor 0.5, or zoom 0.5, all of it would be sharp"
    assert f"50 % of the surface is beyond that and blurs; {with_less}" in budget.notes()[1]
    assert "; with depth_factor 0.5, or zoom 0.75, all" in budget.notes(1.5)[1]
    assert "; with depth_factor 0.37, or zoom 0.66, all" in budget.notes(1.333, 0.75)[1]  # not 0.67: 0.6665


@pytest.mark.parametrize(
    ("depths", "extent"),
    [((0,), "lies in it"), ((-2,), "lies 2 mm behind it"), ((0, 3), "spans 0 mm behind it to 3 mm in front of it")],
)
def test_a_flat_scene_spans_no_depth(depths, extent):
    (note,) = measure_integral(make_sheets(*((depth, 0, 10) for depth in depths)), DISPLAY).notes()
    assert note.endswith(f"; the scene {extent}")


def test_a_scene_in_another_unit_is_to_be_fitted():
    budget = measure_integral(make_sheets((-9000, 0, 10), (0, 0, 1)), DISPLAY)
    line, lost = budget.notes(is_fitted=False)
    assert line == budget.notes()[0]
    assert lost.endswith(
        "leaves the frame in some directions; with fit none, the mesh's coordinates count as mm; leave fit out"
    )
    assert [note.endswith("some directions") for note in budget.notes()] == [False, False, True]
    assert (
        "with depth_factor 0.2, or zoom 0.2, all"
        in measure_integral(make_sheets((-200, 0, 200)), DISPLAY).notes(is_fitted=False)[1]
    )


def test_no_zoom_is_named_that_the_option_refuses():
    note = measure_integral(make_sheets((-3999, 0, 20)), DISPLAY).notes(0.5)[1]
    assert note.endswith("; with depth_factor 0.01, all of it would be sharp")
    note = measure_integral(make_sheets((-4001, 0, 20)), DISPLAY).notes()[1]
    assert note.endswith("; some would still blur with depth_factor or zoom 0.01; give both, or a flatter mesh")


def test_what_leaves_the_frame_in_some_direction_is_counted():
    """tan = 1 mm / 8 mm: at a depth of 40 mm a point moves by up to 5 mm to each side."""
    budget = measure_integral(make_sheets((-39, 42, 1), (39, -47, 1), (0, 47, 1), (0, -47, 1)), DISPLAY)
    assert budget.cut == pytest.approx(0.25)
    assert budget.notes()[1] == "depth: 25 % of the surface leaves the frame in some directions"


@pytest.mark.parametrize("views", [1, 2, 48])
def test_points_leave_the_frame_as_the_cameras_of_a_quilt_see_them(views):
    screen = Screen(0.75, 40.0)
    points = np.random.default_rng(0).uniform((-0.5, -0.6, -1), (0.5, 0.6, 1.5), (4000, 3))
    leaves = np.zeros(len(points), bool)
    for x in screen.camera_x(place_views(views)):
        camera = np.array([x, 0, screen.distance])
        seen = camera + (points - camera) * (screen.distance / (screen.distance - points[:, 2:]))
        leaves |= (np.abs(seen[:, :2]) > [0.375, 0.5]).any(axis=1)
    assert 0.2 < leaves.mean() < 0.9
    assert (frame_screen(screen, views).find_leaving(points) == leaves).all()


def test_points_leave_the_frame_as_the_lenses_of_a_panel_show_them():
    """Of all lines that a wide panel shows in one row, those through a point end between the same places."""
    display = IntegralDisplay(40_000, 1, 0.01, 0.2, 3.0, stripes="none", distance=300.0)
    lens, tangent = (found[:, 0, 0] for found in display.trace_row(0))
    for x, z in ((0, 60), (12, 60), (20, -80), (-20, 30)):
        ends = lens[np.abs(lens - z * tangent - x) < 0.2]
        edge = np.abs(ends).max()
        wide, narrow = (replace(frame_integral(display), size=(2 * (edge + off), 1e9)) for off in (0.3, -0.3))
        assert not wide.find_leaving(np.array([x, 0, z]))
        assert narrow.find_leaving(np.array([x, 0, z]))


def test_what_lies_behind_the_viewer_leaves_the_frame():
    frame = Frame((2, 2), (0.3, 0.3), 5)
    assert frame.find_leaving(np.array([[0, 0, 4.9], [0, 0, 5], [0, 0, 6]])).tolist() == [True, True, True]
    assert not frame.find_leaving(np.array([0, 0, 2.0]))


def test_a_corner_that_leaves_the_frame_counts():
    """A quarter of each triangle stands for each of its corners and for its middle."""
    budget = measure_quilt(make_sheets((0, 0.3, 0.2)), Screen(0.75), 48, 420)
    assert budget.cut == pytest.approx(0.375)  # of two triangles, one has one corner beyond 0.375, the other two


@pytest.mark.parametrize("zoom", [0.5, 1.0, 2.0])
def test_a_scene_shrinks_by_as_much_as_leaves_the_frame(zoom):
    frame, scene = frame_screen(Screen(0.75), 48), make_sheets((0.5, 0, 0.5), (-0.5, 0, 0.4))
    factor = find_shrinking(scene, frame)
    assert 0.5 < factor < 1
    points = np.concatenate([part.vertices for part in scene.parts])
    assert not frame.find_leaving(factor * points).any()
    assert frame.find_leaving(1.0001 * factor * points).any()
    assert find_shrinking(scene.transform(np.diag([zoom, zoom, zoom, 1])), frame, zoom) == pytest.approx(factor)
    assert find_shrinking(make_sheets((0.1, 0, 0.1)), frame) == 1


def test_content_that_moves_too_far_between_views_is_noted():
    cameras = make_views((3, 5), disparities=(3, 3))  # to the right: a disparity of -3
    assert describe_row(cameras, 5, 0.0) == ()
    assert "about 8.1 pixels between neighbouring views" in describe_row(cameras, 5, 5.0)[0]
    assert describe_row(cameras, 9, 5.0) == ()
    assert describe_row(cameras[:, :1], 5, 5.0) == ()


def test_a_light_fields_disparities_are_held_against_the_panel():
    cameras = make_views((3, 5), disparities=(3, 3), side=96)
    # 40 mm of depth move by tan = 1/20 from one view to the next: 2 mm, of 100 mm for 96 pixels.
    (note,) = describe_light_field(cameras, DISPLAY, 0.0)
    assert "sharp for disparities from -1.9 to 1.9 pixels between neighbouring views" in note
    assert note.endswith(
        "those of the views are about -3.1 to -2.9; the rest blurs; "
        "disparity -3 brings its middle into the display's plane"
    )
    assert describe_light_field(cameras, DISPLAY, 6.0)[0].endswith(
        "disparity -3 brings its middle into the display's plane"
    )
    (note,) = describe_light_field(cameras, DISPLAY, -1.2)
    assert note.endswith("about -3.1 to -2.9")
    (note,) = describe_light_field(cameras, replace(DISPLAY, pixel_pitch=0.3), -2.5)  # sharp from -2.7 to -2.3
    assert note.endswith("; the rest blurs; disparity -3 brings its middle into the display's plane")
    (note,) = describe_light_field(cameras, replace(DISPLAY, pixel_pitch=0.6), -3.0)
    assert note.endswith("; the rest blurs")
    assert "no vertical parallax" in describe_light_field(cameras[:1], DISPLAY, 0.0)[1]


@pytest.mark.skipif(not ARRAY.is_file(), reason="needs ../shared")
def test_errors_do_not_widen_the_disparities_of_a_captured_array():
    """99.8 % of `LightField.disparity` are from -0.22 to 0.64, in the order of cameras."""
    light_field = ciir.open(ARRAY, lenses=(200, 200))
    (note,) = describe_light_field(order_as_cameras(light_field), DISPLAY, 0.0)
    least, largest = map(float, re.search(r"about (\S+) to (\S+)$", note).groups())
    assert -0.3 < least < largest < 0.7


@pytest.mark.parametrize("size", [(1, 1), (3, 9)])
def test_the_smallest_views_have_a_note(size):
    assert describe_light_field(np.zeros((2, 3, *size, 3), np.uint8), DISPLAY, 0.0)[0].endswith(TEXTURELESS)


@pytest.mark.parametrize("noise", [0, 2])
def test_no_disparities_are_given_for_views_without_texture(noise):
    """Plain views, each brighter than the one before, fit best where the fewest pixels overlap."""
    plain = np.broadcast_to(np.arange(20, 212, 4)[:, None, None, None], (1, 48, 60, 80, 1))
    noisy = (plain + np.random.default_rng(0).normal(0, noise, plain.shape)).round().astype(np.uint8)
    assert describe_row(noisy, 48, 0.0) == ()
    assert describe_native(noisy, make_calibration(), 0.0)[0].endswith(TEXTURELESS)


def test_a_small_object_before_a_plain_background_has_its_own_disparity():
    y, x = np.mgrid[:96, :128]
    views = np.zeros((3, 5, 96, 128, 1), np.uint8)
    for v, u in np.ndindex(3, 5):
        down, across = y - 48 + 3 * (v - 1), x - 64 + 3 * (u - 2)
        views[v, u, ..., 0] = np.where(down**2 + across**2 < 10**2, 128 + 100 * np.sin(down) * np.sin(across), 0)
    (note,) = describe_light_field(views, DISPLAY, 3.0)
    least, largest = map(float, re.search(r"about (\S+) to ([^;\s]+)", note).groups())
    assert 2 <= least <= largest <= 3.2


def test_a_light_fields_disparities_are_held_against_a_lenticular_display():
    calibration = make_calibration(screenW=60.0, screenH=60.0, pitch=100.0)
    screen = Screen(calibration.aspect, calibration.cone)
    sharp = measure_lenticular(make_sheets((-0.1, 0, 0.1), (0.1, 0, 0.1)), screen, calibration).sharp
    moved = sharp * 2 * math.tan(math.radians(20)) * 48 / 8  # 48 pixels a screen height, 9 views
    cameras = make_views((3, 9), disparities=(4, 4), side=48)
    (note,) = describe_native(cameras, calibration, 0.0)
    assert f"sharp for disparities from {-moved:.2g} to {moved:.2g} pixels" in note
    assert moved < 4
    assert note.endswith(
        "those of the views are about -4.1 to -3.9; the rest blurs; "
        "disparity -4 brings its middle into the display's plane"
    )
    (note,) = describe_native(cameras, calibration, -4.0)
    assert note.endswith("about -4.1 to -3.9")
    assert describe_native(cameras[:, :1], calibration, 0.0) == ()


def test_a_quilt_is_sharp_where_neighbours_differ_by_five_pixels():
    screen = Screen(0.75, 40.0)
    budget = measure_quilt(make_sheets((-0.1, 0, 0.1), (0.1, 0, 0.1)), screen, 48, 420)
    spacing = screen.distance * (math.tan(math.radians(20)) - math.tan(math.radians(20 - 40 / 47)))
    moved = spacing * budget.sharp / screen.distance / (0.75 / 420)
    assert moved == pytest.approx(5.0, rel=1e-6)
    assert budget.unit == "screen heights"
    assert budget.blurred == 0
