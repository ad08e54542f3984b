import numpy as np
import pytest
from scipy import ndimage

from ciir.renderer.focus.stereo.conjugate_gradients import solve
from ciir.renderer.focus.stereo.refinement import FIRST, LAST, refine

SLOPE = 0.8
NOISE = 10
RANDOM = np.random.default_rng(3)
ROOT = RANDOM.standard_normal((20, 20))
MATRIX = ROOT @ ROOT.T + np.diag(RANDOM.uniform(1, 100, 20))


def make_views(grid, side=64, seed=1):
    """Noisy views of a textured plane, by Fourier shifts, which are exact."""
    random = np.random.default_rng(seed)
    texture = ndimage.gaussian_filter(random.standard_normal((side, side, 3)), (2, 2, 0), mode="wrap")
    texture = 128 + 25 * texture / texture.std()
    spectrum, middle = np.fft.fft2(texture, axes=(0, 1)), np.array(grid) // 2
    views = np.empty((*grid, side, side, 3))
    for place in np.ndindex(grid):
        moved = ndimage.fourier_shift(spectrum, (*(SLOPE * (middle - place)), 0))
        views[place] = np.fft.ifft2(moved, axes=(0, 1)).real
    return (views + NOISE * random.standard_normal(views.shape)).clip(0, 255).round().astype(np.uint8), tuple(middle)


@pytest.mark.parametrize("grid", [(9, 9), (1, 9), (13, 5)])
def test_a_wrong_map_of_a_plane(grid):
    views, view = make_views(grid)
    wrong = SLOPE + 0.15 * ndimage.gaussian_filter(np.random.default_rng(2).standard_normal(views.shape[2:4]), 3) * 10
    error = np.abs(refine(views, view, wrong.astype(np.float32), NOISE) - SLOPE)[8:-8, 8:-8]
    assert np.quantile(np.abs(wrong - SLOPE), 0.9) > 0.2
    assert np.quantile(error, 0.9) < 0.04  # texture that is so smooth, through such noise


def test_the_view_itself_decides_which_views_count():
    """Most views show something else, and agree on that; those that show what the view does are few."""
    views, view = make_views((3, 3))
    own = views[view].transpose(2, 0, 1).astype(np.float32)
    others = make_views((3, 3), seed=3)[0]
    for place in ((0, 0), (0, 1), (0, 2), (1, 0), (2, 0)):
        views[place] = others[0, 0]
    wrong = np.full(views.shape[2:4], SLOPE + 0.2, np.float32)
    found = [refine(views, view, wrong, NOISE, LAST, own=given) for given in (own, None)]
    with_own, without = np.median(np.abs(np.array(found) - SLOPE)[:, 8:-8, 8:-8], axis=(1, 2))
    assert with_own < 0.05 < without


def test_strips_of_rows_are_the_same(monkeypatch):
    views, view = make_views((3, 3))
    views[0, 0] = 255 - views[0, 0]  # which does not count, by its neighbourhood
    wrong = np.full(views.shape[2:4], SLOPE + 0.1, np.float32)
    monkeypatch.setattr("ciir.renderer.focus.stereo.refinement.ROWS", 64)
    at_once = refine(views, view, wrong, NOISE, LAST)
    monkeypatch.setattr("ciir.renderer.focus.stereo.refinement.ROWS", 8)
    np.testing.assert_allclose(refine(views, view, wrong, NOISE, LAST), at_once, atol=1e-4)


def test_steps_stay():
    """Where the views show nothing, the map is smoothed, but not across its steps."""
    views = np.full((5, 5, 32, 32, 3), 100, np.uint8)
    map_ = np.repeat(np.float32([0, 2]), 16)[np.newaxis] + np.zeros((32, 1), np.float32)
    np.testing.assert_allclose(refine(views, (2, 2), map_, NOISE), map_, atol=1e-3)


def test_slopes_stay_where_nothing_is_seen():
    """Neighbours agree on the slope; without that they would agree on one disparity."""
    views = np.full((5, 5, 32, 32, 3), 100, np.uint8)
    slope = np.linspace(0, 1.5, 32, dtype=np.float32) + np.zeros((32, 1), np.float32)
    sloping, flat = (refine(views, (2, 2), slope, NOISE, rounds) for rounds in (FIRST, LAST))
    assert np.abs(sloping - slope).max() < 1e-3
    assert np.abs(flat - slope).max() > 0.1


@pytest.mark.parametrize("shape", [(20,), (20, 3)])
def test_solves_each_column(shape):
    wanted = RANDOM.standard_normal(shape)
    diagonal = np.diag(MATRIX).reshape(-1, *[1] * (len(shape) - 1))
    found = solve(lambda x: MATRIX @ x, wanted, diagonal, steps=100, tolerance=1e-12)
    np.testing.assert_allclose(found, np.linalg.solve(MATRIX, wanted), atol=1e-9)


@pytest.mark.parametrize(("steps", "tolerance", "expected"), [(4, 0, 4), (100, 2, 0), (100, 1e-3, None)])
def test_ends_after_the_steps_or_at_the_tolerance(steps, tolerance, expected):
    calls = []

    def apply(x):
        calls.append(x)
        return MATRIX @ x

    solve(apply, np.ones(20), np.diag(MATRIX), steps=steps, tolerance=tolerance)
    assert len(calls) == expected if expected is not None else 4 < len(calls) < 20


def test_nothing_wanted_is_zero():
    np.testing.assert_array_equal(solve(lambda x: MATRIX @ x, np.zeros(20), np.diag(MATRIX), steps=5), np.zeros(20))
