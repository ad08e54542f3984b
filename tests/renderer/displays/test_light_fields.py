from dataclasses import replace

import numpy as np
import pytest

from ciir.renderer.displays.light_fields import (
    fit_pixels,
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
    views = np.zeros((1, 2, 40, 60, 1), np.uint8)
    assert fit_pixels(views, 2, 4800) == (views, ())
    reduced, notes = fit_pixels(views, 2, 4799)
    assert reduced.shape == (1, 2, 20, 30, 1)
    assert notes == ("views of 60x40 pixels are made 2 times smaller",)


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
