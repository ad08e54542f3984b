"""The plane sweep against slow sums, and on views of a plane at a known disparity."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import numpy as np
import torch

from ciir.models.light_field.planes import CLOSE, NEAR, PHASE, REACH, Range, describe_window, place_planes
from ciir.models.light_field.view_filters import make_filters
from ciir.models.light_field.windows import WINDOW_SIDE, select_axis
from ciir.models.single.interpolation import Bicubic
from ciir.training.networks.plane_sweep import BLOCK, LEAST, SINGLE, SURE, PlaneSweep

PLACES = [(4, 9), (0, 9), (8, 9), (3, 5), (1, 3), (0, 2), (0, 1)]
AXES = [select_axis(*at) for at in PLACES]
RANGE = Range(-1.25, 1.0)
DISPARITIES = place_planes(RANGE, 10).tolist()
TAPS = np.arange(-REACH, REACH + 1)


def run(views, rows, cols):
    window = describe_window(rows, cols, RANGE, len(DISPARITIES))
    return PlaneSweep()(views, *(torch.from_numpy(of.copy()) for of in (window.down, window.across)))


def axis_of(axis):
    """The filters of each plane `(planes, 2, views, taps)`, and weights in the deviation `(planes, views, taps)`."""
    used = np.flatnonzero(axis.present)
    offsets = used - int(axis.present.argmax())
    filters = np.zeros((len(DISPARITIES), 2, WINDOW_SIDE, len(TAPS)))
    widths = np.gradient(np.array(DISPARITIES))
    filters[:, :, used] = make_filters(np.array(DISPARITIES), widths, offsets, TAPS, reach=NEAR, phase=PHASE)
    weights = np.zeros((len(DISPARITIES), WINDOW_SIDE, len(TAPS)))
    for plane, disparity in enumerate(DISPARITIES):
        for view, offset in zip(used, offsets, strict=True):
            weights[plane, view] = [max(0.0, 1 - abs(tap - disparity * offset) / CLOSE) for tap in TAPS]
    return filters, weights


def slow_sweep(views, rows, cols):
    """Sums over all samples around each pixel of the views `(25, H, W)`, at once for both axes."""
    _, height, width = views.shape
    (down, near_down), (across, near_across) = axis_of(rows), axis_of(cols)
    fine = np.zeros((len(DISPARITIES), 2, 2, height, width))
    spread = np.zeros((len(DISPARITIES), height, width))
    for y, x in np.ndindex(height, width):
        at = np.clip(y + TAPS, 0, height - 1)[:, None], np.clip(x + TAPS, 0, width - 1)
        samples = views[:, *at].reshape(WINDOW_SIDE, WINDOW_SIDE, len(TAPS), len(TAPS))
        fine[..., y, x] = np.einsum("vust,pavs,pbut->pab", samples, down, across, optimize=True)
        for plane in range(len(DISPARITIES)):
            weight = np.einsum("vs,ut->vust", near_down[plane], near_across[plane])
            weight /= weight.sum()
            lone = (weight**2).sum()
            variance = (weight * (samples - (weight * samples).sum()) ** 2).sum()
            spread[plane, y, x] = np.sqrt((variance + lone * SINGLE**2) / (1 - lone + SURE) + LEAST)
    return fine.reshape(len(DISPARITIES), 4, height, width), spread


@pytest.mark.parametrize(
    ("rows", "cols", "height"), [(0, 1, 3), (3, 2, BLOCK + 1), (4, 5, BLOCK), (6, 0, 2 * BLOCK + 5)]
)
def test_the_sweep_is_the_slow_one(rows, cols, height):
    views = torch.rand(2, WINDOW_SIDE**2, height, 4, generator=torch.Generator().manual_seed(1))
    fine, spread = run(views, AXES[rows], AXES[cols])
    for one in range(2):
        wanted = slow_sweep(views[one].double().numpy(), AXES[rows], AXES[cols])
        np.testing.assert_allclose(fine[one].numpy(), wanted[0], atol=1e-5)
        # The root of what is left of two squares of about 0.3: their float32 steps, over the smallest spread here.
        np.testing.assert_allclose(spread[one].numpy(), wanted[1], atol=1e-4)


def draw_views(disparity, own, side=32):
    """Luma of views `(1, 25, side, side)` of a finely textured plane, means over pixels, and the truth."""
    random = np.random.default_rng(2)
    waves = np.column_stack([random.uniform(-0.55, 0.55, (30, 2)), random.uniform(0, 2 * np.pi, 30)])

    def see(y, x, width):
        def show(often, at):
            return np.sinc(often * width) * np.exp(2j * np.pi * often * at)

        return 0.5 + 0.03 * sum((show(a, y)[:, None] * show(b, x) * np.exp(1j * c)).real for a, b, c in waves)

    at = np.arange(side, dtype=float)
    places = np.ndindex(WINDOW_SIDE, WINDOW_SIDE)
    views = [see(at - disparity * (v - own[0]), at - disparity * (u - own[1]), 1) for v, u in places]
    fine = (np.arange(2 * side) - 0.5) / 2
    return torch.from_numpy(np.stack(views))[None].float(), see(fine, fine, 0.5)


@pytest.mark.parametrize("own", [(2, 2), (0, 4), (1, 2)])
@pytest.mark.parametrize("disparity", [-1.25, -0.5, 0.0, 0.25, 0.75])
def test_views_of_a_plane_agree_at_its_disparity_and_make_a_finer_picture(own, disparity):
    views, truth = draw_views(disparity, own)
    fine, spread = run(views, *(select_axis(at, WINDOW_SIDE) for at in own))
    inner = slice(12, 20)
    right = DISPARITIES.index(disparity)
    deviations = spread[0, :, inner, inner].mean((1, 2))
    assert int(deviations.argmin()) == right
    made = torch.nn.functional.pixel_shuffle(fine[0, right][None], 2)[0, 0].numpy()
    middle = views[:, own[0] * WINDOW_SIDE + own[1]].numpy()
    bicubic = Bicubic(2)(np.repeat(middle[:, None], 3, axis=1))[0, 0]
    inner = slice(24, 40)
    error, interpolated = (np.sqrt(np.mean((of - truth)[inner, inner] ** 2)) for of in (made, bicubic))
    # Without disparity all views have the same samples: there is less noise and blur, and no finer detail.
    assert error < (0.8 if disparity else 1.0) * interpolated


@pytest.mark.parametrize(("rows", "cols"), [((1, 3), (0, 4)), ((2, 3), (2, 5))])
def test_absent_views_are_ignored(rows, cols):
    rows, cols = select_axis(*rows), select_axis(*cols)
    views = torch.rand(1, WINDOW_SIDE, WINDOW_SIDE, 9, 7, generator=torch.Generator().manual_seed(3))
    other = views.clone()
    absent = ~(torch.from_numpy(rows.present > 0)[:, None] & torch.from_numpy(cols.present > 0))
    other[:, absent] = 0.7
    assert absent.any()
    one, same = (run(each.flatten(1, 2), rows, cols) for each in (views, other))
    assert all(torch.equal(a, b) for a, b in zip(one, same, strict=True))
    other[:, 0, 1] = 0.1  # is present
    changed = run(other.flatten(1, 2), rows, cols)
    assert not any(torch.equal(a, b) for a, b in zip(one, changed, strict=True))


def test_filters_without_their_outer_zeros_give_the_same():
    views = torch.rand(2, WINDOW_SIDE**2, 15, 9, generator=torch.Generator().manual_seed(4))
    whole = describe_window(select_axis(1, 3), select_axis(0, 3), Range(-0.25, 0.5), 6)
    short = whole.trim()
    assert short.down.shape[-1] == short.across.shape[-1] < whole.down.shape[-1]
    found, wanted = (PlaneSweep()(views, *(torch.from_numpy(of.copy()) for of in each[:2])) for each in (short, whole))
    for part, same in zip(found, wanted, strict=True):
        torch.testing.assert_close(part, same, atol=1e-5, rtol=0)


def test_a_flat_picture_has_no_deviation_and_stays_flat():
    for axis in AXES:
        fine, spread = run(torch.full((1, WINDOW_SIDE**2, 6, 6), 0.3), axis, AXES[0])
        torch.testing.assert_close(fine, torch.full_like(fine, 0.3), atol=1e-5, rtol=0)
        assert spread.max() < 2 * SINGLE
