"""The plane sweep against slow loops, and the light-field generator."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import numpy as np
import torch

from ciir.models.light_field.windows import select_axis
from ciir.training.networks.collapsible import collapse
from ciir.training.networks.light_field import LightFieldGenerator, merge_layers
from ciir.training.networks.plane_sweep import LEAST, MOST, NEAR, PHASE, REACH, SIDE, SINGLE, SURE, PlaneSweep

THERE = [select_axis(*at).present for at in ((4, 9), (0, 9), (8, 9), (1, 3), (0, 2), (0, 1))]
OFFSETS = range(-(SIDE // 2), SIDE // 2 + 1)


def slow_sweep(views, rows, cols, planes):
    """Shifts each sample of the views `(25, H, W)` to its place, one by one."""
    _, height, width = views.shape
    mean, spread = np.zeros((planes, 4, height, width)), np.zeros((planes, height, width))
    for plane, disparity in enumerate(np.linspace(-MOST, MOST, planes)):
        for y in range(height):
            for x in range(width):
                variances, few = [], []
                for phase, (a, b) in enumerate((i, j) for i in (-PHASE, PHASE) for j in (-PHASE, PHASE)):
                    of, values = [], []
                    for v in range(SIDE):
                        for u in range(SIDE):
                            for down in range(-REACH, REACH + 1):
                                for across in range(-REACH, REACH + 1):
                                    near = [
                                        max(0.0, 1 - abs(step - disparity * (i - SIDE // 2) - off) / NEAR) * there[i]
                                        for step, there, i, off in ((down, rows, v, a), (across, cols, u, b))
                                    ]
                                    row = min(max(y + down, 0), height - 1)
                                    col = min(max(x + across, 0), width - 1)
                                    of.append(near[0] * near[1])
                                    values.append(views[v * SIDE + u, row, col])
                    of, values = np.array(of) / sum(of), np.array(values)
                    mean[plane, phase, y, x] = of @ values
                    variances.append((of @ values**2, (of @ values) ** 2))
                    few.append(of @ of)
                squares, means = np.mean(variances, 0)
                lone = np.mean(few)
                variance = (max(0.0, squares - means) + lone * SINGLE**2) / (1 - lone + SURE)
                spread[plane, y, x] = np.sqrt(variance + LEAST)
    return mean, spread


@pytest.mark.parametrize(("rows", "cols"), [(0, 1), (3, 2), (4, 5)])
def test_the_sweep_is_the_slow_one(rows, cols):
    rows, cols = THERE[rows], THERE[cols]
    views = torch.rand(2, SIDE * SIDE, 3, 4, generator=torch.Generator().manual_seed(1))
    mean, spread = PlaneSweep(5)(views, torch.from_numpy(rows), torch.from_numpy(cols))
    for one in range(2):
        wanted = slow_sweep(views[one].double().numpy(), rows, cols, 5)
        np.testing.assert_allclose(mean[one].numpy(), wanted[0], atol=1e-6)
        # The root of what is left of two squares of about 0.3: their float32 steps, over the smallest spread here.
        np.testing.assert_allclose(spread[one].numpy(), wanted[1], atol=1e-4)


def views_of_a_layer(disparity, side=24):
    """Views `(1, 25, side, side)` of a smooth layer, and the truth, twice as large."""
    waves = np.random.default_rng(2).normal(size=(6, 3))

    def layer(y, x):
        return 0.5 + sum(0.06 * np.sin(0.3 * a * y + 0.3 * b * x + 3 * c) for a, b, c in waves)

    at = np.arange(side, dtype=float)
    views = [layer((at - disparity * v)[:, None], at - disparity * u) for v in OFFSETS for u in OFFSETS]
    fine = (np.arange(2 * side) - 0.5) / 2
    return torch.from_numpy(np.stack(views))[None].float(), torch.from_numpy(layer(fine[:, None], fine)).float()


@pytest.mark.parametrize("there", THERE[:4])
@pytest.mark.parametrize("disparity", [-1.0, -0.25, 0.0, 0.5, 1.25])
def test_views_agree_at_their_disparity_and_make_the_finer_picture(there, disparity):
    views, truth = views_of_a_layer(disparity)
    mean, spread = PlaneSweep(17)(views, torch.from_numpy(there), torch.from_numpy(there))
    inner = (slice(None), slice(10, 14), slice(10, 14))
    right = int(spread[0][inner].mean((1, 2)).argmin())
    all_there = bool(there.all())
    assert abs(right - (disparity + MOST) / 0.25) <= (0 if all_there else 1)  # fewer views are less sharp
    fine = torch.nn.functional.pixel_shuffle(mean[0, right][None], 2)[0, 0]
    off = (fine - truth)[20:28, 20:28].abs().max()
    # Whole shifts bring no samples in between: the view's own, a quarter of a pixel away, is all there is.
    assert off <= (0.01 if all_there and disparity % 1 else 0.04)


def test_missing_views_are_ignored():
    network = LightFieldGenerator((8, 8), planes=5, width=8, depth=1)
    generator = torch.Generator().manual_seed(3)
    image, around = torch.rand(1, 3, 9, 7, generator=generator), torch.rand(1, 25, 9, 7, generator=generator)
    rows, cols = (torch.from_numpy(select_axis(1, 3).present), torch.from_numpy(select_axis(0, 4).present))
    other = around.clone().reshape(1, SIDE, SIDE, 9, 7)
    other[:, [0, 4]] = 0.7
    other[:, :, :2] = 0.1
    assert torch.equal(network(image, around, rows, cols), network(image, other.reshape(1, 25, 9, 7), rows, cols))
    other[:, 1, 3] = 0.1
    assert not torch.equal(network(image, around, rows, cols), network(image, other.reshape(1, 25, 9, 7), rows, cols))


def test_a_merged_network_computes_the_same():
    network = LightFieldGenerator((8, 8), planes=5, width=8, depth=1)
    plain = collapse(network)
    merge_layers(plain)
    generator = torch.Generator().manual_seed(4)
    image, around = torch.rand(1, 3, 9, 7, generator=generator), torch.rand(1, 25, 9, 7, generator=generator)
    there = torch.from_numpy(select_axis(2, 5).present)
    torch.testing.assert_close(
        plain(image, around, there, there), network(image, around, there, there), atol=1e-5, rtol=0
    )
    assert plain.merged is not None
