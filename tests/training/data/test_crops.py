from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.data import degrade, pictures
from ciir.training.data.crops import Crops
from ciir.training.data.downscale import KINDS


@pytest.fixture(scope="module")
def crops(recipe):
    return Crops(Path(recipe.train), crop=24, scale=2, batch=4, seed=9)


def test_a_batch_depends_only_on_seed_and_step(crops, recipe):
    want = crops.make_batch(3)
    fresh = Crops(Path(recipe.train), crop=24, scale=2, batch=4, seed=9)
    assert all(torch.equal(a, b) for a, b in zip(fresh.make_batch(3), want, strict=True))
    assert not torch.equal(crops.make_batch(4)[1], want[1])
    other = Crops(Path(recipe.train), crop=24, scale=2, batch=4, seed=10)
    assert not torch.equal(other.make_batch(3)[1], want[1])


def test_low_and_high_stay_aligned_under_every_flip_and_turn(crops):
    """Inside a crop, the LR crop is what degrading the HR crop gives; misaligned, it is levels away."""
    for step in range(8):
        low, high = crops.make_batch(step)
        difference = (degrade.bicubic(high, 2) - low)[..., 2:-2, 2:-2].abs() * 255
        assert difference.max() <= 1.01


def test_pictures_smaller_than_the_crop_are_skipped_with_a_note(recipe, capsys):
    assert len(Crops(Path(recipe.train), crop=24, scale=2, batch=1, seed=0).groups[0]) == 2
    assert "1 of 3 pictures are skipped: they are smaller than the crop of 24x24" in capsys.readouterr().err
    with pytest.raises(ValueError, match="every picture is smaller than the crop of 60x60"):
        Crops(Path(recipe.train), crop=60, scale=2, batch=1, seed=0)


@pytest.mark.parametrize("kind", KINDS)
def test_every_degradation_keeps_low_and_high_aligned(recipe, kind):
    """The mean over an LR cell of HR is near the LR sample; a pixel off, it is several times further from it."""
    crops = Crops(Path(recipe.train), crop=16, scale=2, batch=16, seed=9, degradations={kind: 1})
    low, high = crops.make_batch(0)
    mean = degrade.box(high, 2)
    aligned = (mean - low).abs().mean()
    assert aligned < 0.3 * (mean - low.roll(1, 2)).abs().mean()
    assert aligned < 0.3 * (mean - low.roll(1, 3)).abs().mean()


@pytest.mark.parametrize("scale", [2, 3, 4])
@pytest.mark.parametrize("kind", KINDS)
def test_crops_are_cut_out_of_whole_degraded_pictures(recipe, kind, scale):
    """To the bit, borders included: 3 pictures of odd sizes, many crops of them."""
    crops = Crops(Path(recipe.train), crop=2 * scale, scale=scale, batch=1, seed=9, degradations={kind: 1})
    for pair, file in zip(crops.groups[0], pictures.find_pictures(Path(recipe.train)), strict=True):
        low, high = degrade.make_pair(kind, torch.from_numpy(pictures.read_rgb(file)).permute(2, 0, 1), scale)
        assert pair.size == low.shape[1:]
        for y in range(pair.size[0] - 1):
            for x in {0, pair.size[1] // 2 - 1, pair.size[1] - 2}:
                part = pair.crop(slice(y, y + 2), slice(x, x + 2))
                assert torch.equal(part[0], low[:, y : y + 2, x : x + 2])
                tall, wide = slice(y * scale, (y + 2) * scale), slice(x * scale, (x + 2) * scale)
                assert torch.equal(part[1], high[:, tall, wide])


def test_memory_makes_no_difference(recipe, crops):
    tight = Crops(Path(recipe.train), crop=24, scale=2, batch=4, seed=9, memory=8000)
    kept = tight.groups[0][0].among._kept
    assert [picture.shape for picture in kept] == [(40, 51, 3)]  # 6120 bytes; the second one needs 6336
    for step in range(3):
        assert all(torch.equal(a, b) for a, b in zip(tight.make_batch(step), crops.make_batch(step), strict=True))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"degradations": {"sinc": 1}}, "no 'sinc' here; give bicubic, box, point; pinhole, lenslet need scenes"),
        ({"degradations": {"pinhole": 1}}, "no 'pinhole' here"),
        ({"degradations": {"sinc": 1}, "scenes": 1}, "give bicubic, box, point, pinhole, lenslet, bicubic-view$"),
        ({"degradations": {}}, "none given"),
        ({"degradations": {"box": 0}}, "share of box is 0; give a number above 0"),
        ({"degradations": {"box": "much"}}, "share of box is 'much'"),
        ({"degradations": {"box": float("nan")}}, "share of box is nan"),
        ({"scenes": 1}, "of no use without pinhole or lenslet"),
        ({"meshes": ["a.obj"]}, "of no use without pinhole or lenslet"),
        ({"crop": 0}, "not a multiple of the scale 2"),
    ],
)
def test_wrong_arguments(recipe, given, message):
    with pytest.raises(ValueError, match=message):
        Crops(Path(recipe.train), **{"crop": 16, "scale": 2, "batch": 1, "seed": 9} | given)
