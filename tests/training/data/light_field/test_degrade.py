"""Many views at once are degraded as pictures are one by one."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.data.downscale import KINDS, downscale_picture
from ciir.training.data.light_field.degrade import degrade
from ciir.training.data.light_field.layered_scenes import FINE


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("channels", [1, 3, 25])
def test_views_are_degraded_as_pictures(kind, channels):
    """Within a level, as halves may be rounded otherwise; a point is of finer samples than the truth."""
    fine = np.random.default_rng(0).integers(0, 256, (2, 12 * FINE, 10 * FINE, channels), np.uint8)
    low, high = degrade(kind, torch.from_numpy(fine).permute(0, 3, 1, 2))
    assert (low.dtype, high.dtype) == (torch.uint8, torch.uint8)
    assert (low.shape, high.shape) == ((2, channels, 12, 10), (2, channels, 24, 20))
    for one in range(2):
        picture = fine[one] if kind == "point" else downscale_picture("box", fine[one], FINE // 2).low
        for found, wanted in zip((low, high), downscale_picture(kind, picture, 2), strict=True):
            difference = found[one].permute(1, 2, 0).numpy().astype(int) - wanted
            assert np.abs(difference).max() <= 1
            assert (difference != 0).mean() < 0.1  # a quarter of the means of four are halves


@pytest.mark.parametrize("kind", KINDS)
def test_a_ramp_keeps_its_place(kind):
    """Four levels from one fine sample to the next: half a sample off is two levels off."""
    ramp = torch.arange(0, 240, 4, dtype=torch.uint8).expand(1, 1, 60, 60)
    for fine in (ramp, ramp.transpose(2, 3)):
        low, high = (part.float() for part in degrade(kind, fine))
        inner = slice(2, -2)
        cells = torch.nn.functional.avg_pool2d(fine.float(), FINE)[..., inner, inner]
        assert (low[..., inner, inner] - cells).abs().max() <= 1
        assert (torch.nn.functional.avg_pool2d(high, 2)[..., inner, inner] - cells).abs().max() <= 1
