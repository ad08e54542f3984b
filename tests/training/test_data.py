from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from training import data, degrade
from training.data import Crops


@pytest.fixture(scope="module")
def crops(recipe):
    return Crops(Path(recipe.train), crop=24, scale=2, batch=4, seed=9)


def test_shapes_and_range(crops):
    low, high = crops.at(0)
    assert low.shape == (4, 3, 12, 12)
    assert high.shape == (4, 3, 24, 24)
    assert (low.min() >= 0) & (low.max() <= 1)
    assert (high.min() >= 0) & (high.max() <= 1)


def test_a_step_is_the_same_whatever_came_before(crops, recipe):
    want = crops.at(3)
    fresh = Crops(Path(recipe.train), crop=24, scale=2, batch=4, seed=9)
    assert all(torch.equal(a, b) for a, b in zip(fresh.at(3), want, strict=True))
    assert not torch.equal(crops.at(4)[1], want[1])
    other = Crops(Path(recipe.train), crop=24, scale=2, batch=4, seed=10)
    assert not torch.equal(other.at(3)[1], want[1])


def test_low_and_high_stay_aligned_under_every_flip_and_turn(crops):
    """Inside a crop, the LR crop is what degrading the HR crop gives; misaligned, it is levels away."""
    for step in range(8):
        low, high = crops.at(step)
        difference = (degrade.bicubic(high, 2) - low)[..., 2:-2, 2:-2].abs() * 255
        assert difference.max() <= 1.01


def test_pictures_smaller_than_the_crop_are_left_out(recipe):
    assert len(Crops(Path(recipe.train), crop=24, scale=2, batch=1, seed=0).groups[0]) == 2
    with pytest.raises(ValueError, match="smaller than the crop of 60x60"):
        Crops(Path(recipe.train), crop=60, scale=2, batch=1, seed=0)


def test_a_crop_that_the_scale_does_not_divide(recipe):
    with pytest.raises(ValueError, match="not a multiple of the scale 2"):
        Crops(Path(recipe.train), crop=25, scale=2, batch=1, seed=0)


def test_a_folder_without_pictures(tmp_path):
    with pytest.raises(ValueError, match="no picture in it"):
        Crops(tmp_path, crop=24, scale=2, batch=1, seed=0)


@pytest.mark.parametrize("kind", ["bicubic", "box", "point"])
def test_every_degradation_keeps_low_and_high_aligned(recipe, kind):
    """The mean over an LR cell of HR is near the LR sample; a pixel off, it is several times further from it."""
    crops = Crops(Path(recipe.train), crop=16, scale=2, batch=16, seed=9, degradations={kind: 1})
    low, high = crops.at(0)
    mean = degrade.box(high, 2)
    aligned = (mean - low).abs().mean()
    assert aligned < 0.3 * (mean - low.roll(1, 2)).abs().mean()
    assert aligned < 0.3 * (mean - low.roll(1, 3)).abs().mean()


def test_a_point_is_smaller_than_a_pixel_of_the_truth(recipe):
    """Otherwise it would be the box: here it differs from it where the photograph is rough."""
    rough = torch.randint(0, 256, (3, 40, 44), generator=torch.Generator().manual_seed(2), dtype=torch.uint8)
    low, high = data._degraded("point", rough, 2)
    assert (low.shape, high.shape) == ((3, 10, 11), (3, 20, 22))
    middle = rough.reshape(3, 10, 4, 11, 4)[:, :, 1:3, :, 1:3].float().mean((2, 4))
    assert (low - middle).abs().max() <= 0.5


def test_a_degradation_that_is_not_there(recipe):
    for kind in ("sinc", "pinhole"):
        with pytest.raises(ValueError, match=f"no '{kind}' here"):
            Crops(Path(recipe.train), crop=16, scale=2, batch=1, seed=9, degradations={kind: 1})
