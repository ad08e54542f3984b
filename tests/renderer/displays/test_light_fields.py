from dataclasses import replace

import numpy as np
import pytest

from ciir.errors import TooLarge
from ciir.renderer.displays.light_fields import (
    find_padded_size,
    find_reduction,
    make_quilt,
    order_as_cameras,
    pad_to_aspect,
    reduce_views,
    take_row,
)
from ciir.renderer.displays.quilt import QuiltLayout, split_quilt
from ciir.renderer.light_field import LightField
from tests.support.light_fields import make_views

NUMBERED = np.arange(15, dtype=np.uint8).reshape(3, 5, 1, 1, 1)


def test_views_of_a_lens_array_are_a_camera_arrays_in_the_opposite_order():
    assert np.array_equal(order_as_cameras(LightField(NUMBERED, depth_sense="cameras")), NUMBERED)
    assert order_as_cameras(LightField(NUMBERED, depth_sense="lenses"))[0, 0, 0, 0, 0] == 14
    assert take_row(order_as_cameras(LightField(NUMBERED)), 5)[0].ravel().tolist() == [9, 8, 7, 6, 5]


def test_what_is_see_through_is_laid_over_black():
    views = np.zeros((1, 1, 1, 3, 4), np.uint16)
    views[..., 0], views[0, 0, 0, :, 3] = 65535, [0, 32768, 65535]
    found = order_as_cameras(LightField(views))
    assert found.tolist() == [[[[[0, 0, 0], [32768, 0, 0], [65535, 0, 0]]]]]
    assert order_as_cameras(LightField(np.full((1, 1, 2, 2, 2), 255, np.uint8))).shape == (1, 1, 2, 2, 1)


def test_a_row_says_where_its_views_come_from():
    cameras = make_views((3, 5), disparities=(1, 1))
    assert take_row(cameras, 5)[1] == ()
    assert take_row(cameras, 9)[1] == ("9 views are interpolated from the 5 of the middle row",)
    assert take_row(cameras, 3)[1] == ("3 views are chosen among the 5 of the middle row",)
    assert take_row(cameras, 4)[1] == ("4 views are interpolated from the 5 of the middle row",)
    assert take_row(cameras, 1)[1] == ("1 views are chosen among the 5 of the middle row",)
    assert "no horizontal parallax" in take_row(cameras[:, :1], 4)[1][0]


@pytest.mark.parametrize("disparity", [2, -1])
def test_what_has_the_disparity_stays_in_its_place(disparity):
    cameras = make_views((1, 5), disparities=(-disparity, -disparity), side=48)  # content moves by these to the right
    row, _ = take_row(cameras, 5, disparity=disparity)
    inside = row[:, :, 8:-8]  # a shift takes pixels from up to 4 to the side
    assert np.array_equal(inside, np.broadcast_to(inside[2], inside.shape))


def test_views_get_borders_to_the_aspect_that_is_shown():
    views = np.full((2, 30, 60, 3), 9, np.uint8)
    wide, (note,) = pad_to_aspect(views, 2.0, 3.0)
    assert wide.shape == (2, 30, 90, 3)
    assert (wide[:, :, 15:75] == 9).all()
    assert wide.sum() == views.sum()
    assert note == "black borders bring views of 60x30 pixels to the aspect 3"
    assert pad_to_aspect(views, 2.0, 1.0)[0].shape == (2, 60, 60, 3)
    assert pad_to_aspect(views, 1.0, 1.0) == (views, ())  # pixels that are half as wide as high
    assert pad_to_aspect(views, 1.0, 0.5)[0].shape == (2, 60, 60, 3)


def test_pixels_are_averaged_and_margins_cut_off_evenly():
    views = np.arange(2 * 5 * 8, dtype=np.uint8).reshape(2, 5, 8, 1)
    reduced = reduce_views(views, (3, 3))
    assert reduced.shape == (2, 1, 2, 1)
    assert reduced[1, 0, 1, 0] == round(views[1, 1:4, 4:7].mean())
    reduced = reduce_views(views, (2, 3))
    assert reduced.shape == (2, 2, 2, 1)
    assert reduced[1, 1, 1, 0] == round(views[1, 2:4, 4:7].mean())


def test_a_picture_that_would_be_too_large_is_made_of_smaller_views():
    given, layout = LightField(np.zeros((1, 2, 40, 60, 1), np.uint8)), QuiltLayout(2, 1, 1.5)
    assert make_quilt(given, layout, own_aspect=1.5, keeps_aspect=True, max_pixels=4800)[2] == ()
    quilt, _, notes = make_quilt(given, layout, own_aspect=1.5, keeps_aspect=True, max_pixels=4799)
    assert quilt.shape == (20, 60, 1)
    assert notes == ("views of 60x40 pixels are made 2 times smaller",)


@pytest.mark.parametrize("stretch", [0.0123, 0.5, 1.0, 1.37, 80])
def test_borders_count_as_pixels(stretch):
    for most in range(1000, 20000, 371):
        factor = find_reduction((47, 60), 6, most, stretch)
        smaller, larger = (find_padded_size((47 // by, 60 // by), stretch) for by in (factor, max(1, factor - 1)))
        assert 6 * smaller[0] * smaller[1] <= most
        assert factor == 1 or 6 * larger[0] * larger[1] > most
    with pytest.raises(TooLarge, match=r"6 views of 60x47 pixels .* 5 pixels even if reduced; give fewer views or"):
        find_reduction((47, 60), 6, 5, stretch)


def test_a_quilt_with_borders_keeps_the_limit():
    given = LightField(make_views((1, 6), disparities=(1, 1), side=24, channels=3), depth_sense="cameras")
    layout = QuiltLayout(3, 2, 0.1)
    quilt, _, notes = make_quilt(given, layout, own_aspect=1.0, keeps_aspect=False, max_pixels=10000)
    assert quilt.shape == (2 * 120, 3 * 12, 3)
    assert notes[0] == "views of 24x24 pixels are made 2 times smaller"


def test_a_disparity_counts_pixels_of_the_given_views():
    given = LightField(make_views((1, 5), disparities=(-4, -4), side=128), depth_sense="cameras")
    layout = QuiltLayout(5, 1, 1.0)
    quilt, found, notes = make_quilt(
        given, layout, own_aspect=1.0, keeps_aspect=True, disparity=4, max_pixels=5 * 64 * 64
    )
    assert notes == ("views of 128x128 pixels are made 2 times smaller",)
    inside = split_quilt(quilt, found, name="q")[:, :, 8:-8]
    assert np.array_equal(inside, np.broadcast_to(inside[2], inside.shape))
    notes = make_quilt(given, layout, own_aspect=1.0, keeps_aspect=True, disparity=-16, max_pixels=5 * 64 * 64)[2]
    assert "content moves by about 10 pixels between neighbouring views of the display" in notes[1]
    assert notes[1].endswith("; disparity 4 brings its middle into the display's plane")


def test_a_quilt_keeps_the_views_and_their_aspect():
    views = make_views((1, 6), disparities=(1, 1), side=20, channels=3)
    given = LightField(views, depth_sense="cameras")
    layout = QuiltLayout(3, 2, 0.75)
    quilt, found, notes = make_quilt(given, layout, own_aspect=1.0, keeps_aspect=True, max_pixels=10**6)
    assert found == QuiltLayout(3, 2, 1.0)
    assert len(notes) == 1
    assert notes[0].startswith("views keep their aspect 1, not the device's 0.75; name the device")
    square = replace(layout, aspect=1.0)
    assert make_quilt(given, square, own_aspect=1.0, keeps_aspect=True, max_pixels=10**6)[2] == ()
    assert np.array_equal(split_quilt(quilt, found, name="q"), views[0])
    quilt, found, notes = make_quilt(given, layout, own_aspect=1.0, keeps_aspect=False, max_pixels=10**6)
    assert found == layout
    assert quilt.shape == (2 * 27, 3 * 20, 3)
    assert len(notes) == 1
