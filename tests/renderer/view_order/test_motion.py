"""How far content moves from one view to the next."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from ciir.renderer.view_order import motion
from ciir.renderer.view_order.evidence import REACH
from ciir.renderer.view_order.motion import measure_motion


def make_views(grid, disparity, side=96):
    """Grey views of a textured plane that moves by `disparity` pixels from one to the next."""
    texture = gaussian_filter(np.random.default_rng(3).random((side, side)), 1.5)
    texture = 40 + 170 * (texture - texture.min()) / np.ptp(texture)
    views = np.empty((*grid, side, side, 1), np.uint8)
    for v, u in np.ndindex(*grid):
        views[v, u, ..., 0] = shift(texture, (disparity * v, disparity * u), order=3, mode="reflect").round()
    return views


@pytest.mark.parametrize("disparity", [0.0, 0.125, -0.25, 0.5, 1.25])
@pytest.mark.parametrize("grid", [(9, 9), (10, 11)])
def test_it_is_that_of_a_plane(grid, disparity):
    assert measure_motion(make_views(grid, disparity)) == pytest.approx(abs(disparity), abs=0.07)


def test_nothing_is_said_of_small_grids_small_or_flat_views_and_noise():
    views = make_views((9, 9), 0.25)
    assert measure_motion(views[:8]) is None
    assert measure_motion(views[:, :, :40, :40]) is None
    assert measure_motion(np.full_like(views, 90)) is None
    noise = np.random.default_rng(0).integers(0, 256, views.shape, np.uint8)
    assert measure_motion(noise) is None


def test_what_is_not_found_again_counts_as_moving_far():
    views = make_views((9, 9), 0.125, side=160)
    views[..., :80, :] = make_views((9, 9), 3.0, side=160)[..., :80, :]
    assert measure_motion(views) >= 1


def test_the_shift_of_what_is_not_found_again_does_not_count(monkeypatch):
    def lose_every_third(correlation):
        is_lost = np.arange(len(correlation)) % 3 == 0
        return np.full(len(correlation), 0.5), np.where(is_lost, 0.2, 0.9)

    monkeypatch.setattr(motion, "find_shifts", lose_every_third)
    assert measure_motion(make_views((9, 9), 0.125, side=160)) == REACH / motion.STEP


def test_a_small_part_that_moves_more_does_not_count():
    views = make_views((9, 9), 0.125, side=160)
    near = make_views((9, 9), 1.0, side=160)
    views[:, :, :24, :24] = near[:, :, :24, :24]
    assert measure_motion(views) == pytest.approx(0.125, abs=0.07)
