"""What the comparison says of pictures that are right, and of pictures that are wrong in a known way."""

import numpy as np
import pytest

from ciir.benchmarks.stress.geometry.agreement import BAND, compare, compute_direction, locate_samples
from ciir.renderer.lens_array import LensArray

ARRAY = LensArray(24, 30, 3, 5)
VIEWS = [(1, 2)]


def disc(starts, along):
    """A disc of radius 9.3 whose colour slowly changes."""
    inside = np.hypot(starts[:, 0], starts[:, 1]) < 9.3
    rgba = np.stack([100 + 3 * starts[:, 0], 100 - 3 * starts[:, 1], 0 * starts[:, 0] + 50, 0 * starts[:, 0] + 255], 1)
    return np.where(inside[:, None], rgba, 0.0)


def drawn(*, shift=0.0):
    """The disc as a renderer with its samples `shift` pixels to the right would draw it."""
    row, col = np.divmod(np.arange(ARRAY.rows * ARRAY.cols), ARRAY.cols)
    starts = locate_samples(ARRAY, row, col) + np.array([shift * ARRAY.pitch, 0, 0])
    return np.rint(disc(starts, compute_direction(ARRAY, VIEWS[0]))).astype(np.uint8).reshape(ARRAY.rows, ARRAY.cols, 4)


def broken(picture):
    return [
        one.what.partition(": ")[2] for one in compare([picture], VIEWS, ARRAY, disc).list_bounds("it") if not one.holds
    ]


def test_what_is_right_holds():
    found = compare([drawn()], VIEWS, ARRAY, disc)
    assert found.worst <= 0.5
    assert (found.moved, found.silhouette) == (0, 0.0)
    assert found.covered == (drawn()[..., 3] > 0).sum()
    assert broken(drawn()) == []


def test_one_wrong_pixel_breaks_the_bound_on_colour():
    picture = drawn()
    picture[12, 15, 1] += 5
    assert broken(picture) == ["worst colour away from edges, levels"]
    assert compare([picture], VIEWS, ARRAY, disc).at == "view 1,2, pixel 12,15"


def test_a_hole_counts_as_colour():
    picture = drawn()
    picture[12, 15] = 0
    assert broken(picture) == ["worst colour away from edges, levels"]


@pytest.mark.parametrize("shift", [0.2, 0.5])
def test_a_picture_out_of_place_is_noticed(shift):
    assert broken(drawn(shift=shift))


def test_an_outline_a_little_out_of_place_is_measured():
    array = LensArray(300, 300, 3, 5, pitch=0.1)
    row, col = np.divmod(np.arange(300 * 300), 300)
    starts = locate_samples(array, row, col)

    def look(shift):
        return np.rint(disc(starts + np.array([shift * array.pitch, 0, 0]), None)).astype(np.uint8).reshape(300, 300, 4)

    assert compare([look(BAND / 2)], VIEWS, array, disc).silhouette <= BAND
    within = compare([look(0.06)], VIEWS, array, disc, band=0.1)
    assert 1 / 32 <= within.silhouette <= 1 / 16
