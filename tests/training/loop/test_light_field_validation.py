"""Validation of light-field networks: inputs and score."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from PIL import Image
from torch import nn

from ciir.models.light_field.planes import describe_window
from ciir.models.light_field.windows import select_axis
from ciir.training.data.downscale import KINDS, Pair
from ciir.training.data.light_field.layered_scenes import LUMA
from ciir.training.data.light_field.views import degrade_views
from ciir.training.loop import light_field_validation


@pytest.mark.parametrize(("grid", "at"), [((5, 5), (2, 2)), ((7, 3), (0, 2)), ((3, 6), (1, 4))])
def test_a_window_holds_the_views_around(grid, at):
    """Row by row, the nearest 5 of the grid; where it has fewer the view itself, which no filter takes."""
    low = np.random.default_rng(0).integers(0, 256, (*grid, 6, 8, 3), np.uint8)
    image, around, down, across, window = light_field_validation.make_inputs(low, *at, 7)
    assert (image.shape, around.shape) == ((1, 3, 6, 8), (1, 25, 6, 8))
    assert down.shape == across.shape == (7, 3, 5, 11)
    axes = [select_axis(*place) for place in zip(at, grid, strict=True)]
    wanted = describe_window(*axes, light_field_validation.DISPARITIES, 7)
    for found, part in zip((down, across, window), wanted, strict=True):
        np.testing.assert_array_equal(found, part)
    np.testing.assert_allclose(image[0].permute(1, 2, 0) * 255, low[at], atol=1e-4)
    for slot, luma in enumerate(around[0]):
        place = []
        for number, of, own, filters in zip(divmod(slot, 5), grid, at, (down, across), strict=True):
            seen = max(0, min(own - 2, of - 5)) + number
            assert bool(filters[:, :, number].any()) == (seen < of)
            place.append(seen if seen < of else own)
        seen = low[tuple(place)]
        np.testing.assert_allclose(luma * 255, seen @ np.array(LUMA), atol=1e-3)  # float32 of numbers up to 255


def test_the_middle_views_are_degraded_in_each_way(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (7, 6, 20, 16, 3), np.uint8)
    for v in range(7):
        for u in range(6):
            Image.fromarray(pixels[v, u]).save(tmp_path / f"view_{v}_{u}.png")
    found = light_field_validation.read_light_field(tmp_path, 2)
    assert len(found) == len(KINDS)
    for kind, pair in zip(KINDS, found, strict=True):
        wanted = degrade_views(pixels[1:6, 1:6], kind, 2)
        assert all(np.array_equal(got, want) for got, want in zip(pair, wanted, strict=True))


class Nearest(nn.Module):
    """Each pixel of the view four times, and `error` levels more in one of the four."""

    planes = 4

    def __init__(self, error):
        super().__init__()
        self.error = nn.Parameter(torch.tensor(float(error)))

    def forward(self, image, around, down, across, window):
        assert not self.training
        assert len(down) == self.planes
        assert torch.equal(down, across)
        made = image.repeat_interleave(2, 2).repeat_interleave(2, 3)
        made[..., ::2, ::2] += self.error / 255
        return made


def test_a_known_error_in_the_middle_view():
    """Grey: a quarter of the pixels off by e levels is e^2/4 in the mean, (219/255)^2 of that on Y's studio range."""
    low = np.random.default_rng(0).integers(0, 200, (3, 3, 12, 12, 1), np.uint8).repeat(3, axis=-1)
    pair = Pair(low, low.repeat(2, axis=2).repeat(2, axis=3))
    pair.high[:, :, :2], pair.high[:, :, :, -2:] = 0, 255  # a border of 2 is cut
    network = Nearest(4).train()
    other = Pair(low, np.clip(pair.high.astype(int) + 1, 0, 255).astype(np.uint8))  # 3, and three times -1: 12/4
    wanted = [10 * np.log10(255**4 / 219**2 / square) for square in (4, 3)]
    assert light_field_validation.validate_network(network, [pair]) == pytest.approx(wanted[0], abs=1e-3)
    assert light_field_validation.validate_network(network, [pair, other]) == pytest.approx(np.mean(wanted), abs=1e-3)
    assert network.training
