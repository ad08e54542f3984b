"""Validation of light-field networks: views, disparities and score."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from PIL import Image
from torch import nn

from ciir.training.data.downscale import KINDS, Pair
from ciir.training.data.light_field.views import degrade_views
from ciir.training.export.measure import find_receptive_radius
from ciir.training.loop import light_field_validation
from ciir.training.networks.light_field import LightFieldGenerator


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
        self.windows = []

    def forward(self, image, around, down, across, window):
        assert not self.training
        assert len(down) == self.planes
        assert torch.equal(down, across)
        self.windows.append(window.tolist())
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


@pytest.mark.parametrize(("disparity", "remaining"), [(-0.4, -0.4), (0.7, 0.7), (2.2, 0.2)])
def test_planes_lie_around_the_disparities_of_the_views(disparity, remaining):
    """In LR pixels. Views that differ by more than 1.5 are first shifted by whole pixels."""
    y, x = np.mgrid[:64, :64]
    places = [(v * disparity, u * disparity) for v in range(-2, 3) for u in range(-2, 3)]
    waves = [np.sin((y - down) / 2.1) + np.sin((x - across) / 1.7 + y / 5) for down, across in places]
    levels = (127.5 + 50 * np.stack(waves)).round().astype(np.uint8)
    low = levels.reshape(5, 5, 64, 64, 1).repeat(3, axis=-1)
    network = Nearest(0)
    light_field_validation.validate_network(network, [Pair(low, low.repeat(2, axis=2).repeat(2, axis=3))])
    (*_, lowest, highest), *others = network.windows
    assert not others
    assert lowest < remaining < highest < lowest + 0.7


@pytest.mark.parametrize("options", [{}, {"widths": [8, 8], "width": 8, "depth": 1, "guard": True}])
def test_tiles_overlap_by_the_receptive_field(options):
    network = LightFieldGenerator(**options).eval()
    assert light_field_validation._NetworkInTraining(network).radius >= find_receptive_radius(network, 2)
