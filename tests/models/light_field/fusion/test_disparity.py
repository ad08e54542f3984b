import numpy as np
import pytest
from scipy import ndimage

from ciir.models.light_field.fusion.disparity import estimate_disparity
from ciir.models.light_field.planes import Range

OFFSETS = ((-1, 0), (1, 0), (0, -1), (0, 1))


def make_texture(height, width, seed=0):
    noise = np.random.default_rng(seed).random((height, width))
    smooth = ndimage.gaussian_filter(noise, 1.5)
    return (smooth - smooth.min()) / np.ptp(smooth) * 4  # of a contrast of about 1


def look(texture, disparity, offset):
    """The texture, whose content moves by `disparity` for each view."""
    moved = [step * disparity for step in offset]
    return ndimage.shift(texture, moved, order=3, mode="nearest").astype(np.float32)


@pytest.mark.parametrize("disparity", [-1.3, 0.0, 0.4, 2.61])
def test_finds_fractions_of_a_pixel(disparity):
    texture = make_texture(40, 50)
    beside = {offset: look(texture, disparity, offset) for offset in OFFSETS}
    found = estimate_disparity(texture.astype(np.float32), beside, Range(-3, 3))
    assert found.shape == (40, 50)
    inside = found[6:-6, 6:-6]
    assert abs(np.median(inside) - disparity) < 0.02
    assert np.mean(np.abs(inside - disparity) < 0.1) > 0.95


@pytest.mark.parametrize(("disparity", "limits"), [(0.7, Range(-1, 1)), (-2.8, Range(-3, 0))])
def test_neighbours_further_away_count_in_steps(disparity, limits):
    texture = make_texture(40, 50)
    beside = {offset: look(texture, disparity, offset) for offset in ((0, 1), (0, 2), (1, 0), (2, 0))}
    found = estimate_disparity(texture.astype(np.float32), beside, limits)[6:-6, 6:-6]
    assert abs(np.median(found) - disparity) < 0.02


def test_farther_views_make_it_more_exact():
    texture, rng = make_texture(40, 50), np.random.default_rng(1)
    far = [(2 * down, 2 * right) for down, right in OFFSETS]
    views = {offset: look(texture, 0.4, offset) + rng.normal(0, 0.05, (40, 50)) for offset in ((0, 0), *OFFSETS, *far)}
    own, errors = views.pop((0, 0)), []
    for offsets in (OFFSETS, (*OFFSETS, *far)):
        found = estimate_disparity(own, {offset: views[offset] for offset in offsets}, Range(-1, 1))
        errors.append(np.std(found[6:-6, 6:-6] - 0.4))
    assert errors[1] < 0.9 * errors[0]


@pytest.mark.parametrize("shape", [(1, 1), (1, 20), (20, 1), (2, 2), (3, 7)])
def test_views_of_any_size(shape):
    noise = np.random.default_rng(0).random((5, *shape), np.float32)
    found = estimate_disparity(noise[0], dict(zip(OFFSETS, noise[1:], strict=True)), Range(-2, 2))
    assert found.shape == shape
    assert np.isfinite(found).all()


def test_two_depths_are_told_apart():
    near, far = make_texture(48, 64, 1), make_texture(48, 64, 2)
    views = {}
    for offset in ((0, 0), *OFFSETS):
        views[offset] = look(far, -0.5, offset)
        views[offset][:, :32] = look(near, 0.5, offset)[:, :32]
    found = estimate_disparity(views.pop((0, 0)), views, Range(-1, 1))
    assert np.abs(np.median(found[:, 6:26]) - 0.5) < 0.05
    assert np.abs(np.median(found[:, 38:58]) + 0.5) < 0.05


def test_stays_near_the_limits_whatever_it_sees():
    noise = np.random.default_rng(0).random((5, 12, 14), np.float32)
    for limits in (Range(0.25, 0.25), Range(-0.5, 0.75)):
        found = estimate_disparity(noise[0], dict(zip(OFFSETS, noise[1:], strict=True)), limits)
        assert np.isfinite(found).all()
        assert found.min() >= limits.lowest - 1
        assert found.max() <= limits.highest + 1


def test_flat_views_are_in_range():
    flat = np.full((9, 9), 0.5, np.float32)
    found = estimate_disparity(flat, dict.fromkeys(OFFSETS, flat), Range(-1, 1))
    assert np.all(np.abs(found) <= 1)
