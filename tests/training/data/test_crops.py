from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import numpy as np
import torch

from ciir.training.data import crops as data
from ciir.training.data import pictures
from ciir.training.data.crops import Crops
from ciir.training.data.downscale import KINDS, Pair, downscale_picture
from tests.training import degradations


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
        difference = (degradations.bicubic(high, 2) - low)[..., 2:-2, 2:-2].abs() * 255
        assert difference.max() <= 1.01


def test_pictures_smaller_than_the_crop_are_skipped_with_a_note(recipe, capsys):
    assert len(Crops(Path(recipe.train), crop=24, scale=2, batch=1, seed=0).groups[0]) == 2
    assert "1 of 3 pictures are skipped: they are smaller than the crop of 24x24" in capsys.readouterr().err
    with pytest.raises(ValueError, match="every picture is smaller than the crop of 60x60"):
        Crops(Path(recipe.train), crop=60, scale=2, batch=1, seed=0)


def test_a_crop_that_the_scale_does_not_divide(recipe):
    with pytest.raises(ValueError, match="not a multiple of the scale 2"):
        Crops(Path(recipe.train), crop=25, scale=2, batch=1, seed=0)


def test_a_folder_without_pictures(tmp_path):
    with pytest.raises(ValueError, match="no picture in it"):
        Crops(tmp_path, crop=24, scale=2, batch=1, seed=0)


@pytest.mark.parametrize("kind", KINDS)
def test_every_degradation_keeps_low_and_high_aligned(recipe, kind):
    """The mean over an LR cell of HR is near the LR sample; a pixel off, it is several times further from it."""
    crops = Crops(Path(recipe.train), crop=16, scale=2, batch=16, seed=9, degradations={kind: 1})
    low, high = crops.make_batch(0)
    mean = degradations.box(high, 2)
    aligned = (mean - low).abs().mean()
    assert aligned < 0.3 * (mean - low.roll(1, 2)).abs().mean()
    assert aligned < 0.3 * (mean - low.roll(1, 3)).abs().mean()


@pytest.mark.parametrize("scale", [2, 3, 4])
@pytest.mark.parametrize("kind", KINDS)
def test_crops_are_cut_out_of_whole_degraded_pictures(recipe, kind, scale):
    """To the bit, borders included: 3 pictures of odd sizes, many crops of them."""
    crops = Crops(Path(recipe.train), crop=2 * scale, scale=scale, batch=1, seed=9, degradations={kind: 1})
    for pair, file in zip(crops.groups[0], pictures.find_pictures(Path(recipe.train)), strict=True):
        low, high = downscale_picture(kind, pictures.read_rgb(file), scale)
        assert pair.size == low.shape[:2]
        for y in range(pair.size[0] - 1):
            for x in {0, pair.size[1] // 2 - 1, pair.size[1] - 2}:
                part = pair.crop(slice(y, y + 2), slice(x, x + 2))
                assert np.array_equal(part.low, low[y : y + 2, x : x + 2])
                tall, wide = slice(y * scale, (y + 2) * scale), slice(x * scale, (x + 2) * scale)
                assert np.array_equal(part.high, high[tall, wide])


def test_memory_makes_no_difference(recipe, crops):
    tight = Crops(Path(recipe.train), crop=24, scale=2, batch=4, seed=9, memory=8000)
    kept = tight.groups[0][0].among._kept
    assert [picture.shape for picture in kept] == [(40, 51, 3)]  # 6120 bytes; the second one needs 6336
    for step in range(3):
        assert all(torch.equal(a, b) for a, b in zip(tight.make_batch(step), crops.make_batch(step), strict=True))


@pytest.mark.parametrize(
    "corruption", [{"noise": 8.0}, {"blur": 1.5}, {"jpeg": 20}, {"noise": 8.0, "blur": 1.5, "jpeg": 20}]
)
def test_noise_blur_and_jpeg_are_done_to_lr_alone(recipe, crops, corruption):
    corrupted = Crops(Path(recipe.train), crop=24, scale=2, batch=4, seed=9, **corruption)
    (low, high), (clean, same) = corrupted.make_batch(5), crops.make_batch(5)
    assert torch.equal(high, same)
    assert 0.2 / 255 < (low - clean).abs().mean() < 20 / 255
    assert torch.equal(low * 255, (low * 255).round())
    assert all(torch.equal(a, b) for a, b in zip(corrupted.make_batch(5), (low, high), strict=True))
    assert not torch.equal(low - clean, corrupted.make_batch(6)[0] - crops.make_batch(6)[0])


def test_a_share_of_crops_is_corrupted(recipe, crops):
    """The others are the clean ones to the bit, at the same places."""
    given = {"crop": 24, "scale": 2, "batch": 64, "seed": 9, "noise": 20.0}
    (none, high), some, every = (
        Crops(Path(recipe.train), **given, corrupted=share).make_batch(0) for share in (0.0, 0.3, 1.0)
    )
    assert torch.equal(some[1], high)
    assert torch.equal(every[1], high)
    few, most = ((low - none).abs().amax((1, 2, 3)).gt(0).float().mean() for low in (some[0], every[0]))
    assert 0.15 < few < 0.45
    assert most > 0.9  # the strength of noise is drawn too


@pytest.mark.parametrize("corruption", [{}, {"noise": 8.0, "blur": 1.0, "jpeg": 20, "corrupted": 0.3}])
def test_batches_of_a_stack_are_the_same(recipe, corruption):
    """Those that a GPU cuts out of its own copy of all pairs, here on the CPU: to the bit, in all orientations."""
    shares = {"bicubic": 2, "box": 1, "point": 1}
    crops = Crops(Path(recipe.train), crop=16, scale=2, batch=40, seed=9, degradations=shares, **corruption)
    each = [crops.make_batch(step) for step in range(3)]
    crops._stack = crops._stack_pairs(torch.device("cpu"))
    for step, wanted in enumerate(each):
        made = crops.make_batch(step)
        assert all(torch.equal(a, b) for a, b in zip(made, wanted, strict=True))


def test_a_step_s_crops_are_drawn_by_share_from_everywhere(recipe):
    """Every pair of a group, every place in it and every orientation is as likely."""
    shares = {"bicubic": 3, "point": 1}
    crops = Crops(Path(recipe.train), crop=16, scale=2, batch=4000, seed=9, degradations=shares)
    places = crops._draw_places(0)
    pair, orientation = np.bincount(places.pair, minlength=5) / 4000, np.bincount(places.orientation) / 4000
    np.testing.assert_allclose(pair, [0.25, 0.25, 0.25, 0.125, 0.125], atol=0.04)
    np.testing.assert_allclose(orientation, [1 / 8] * 8, atol=0.03)
    for number, (height, width) in enumerate(crops._sizes):
        among = places.pair == number
        assert set(places.y[among]) == set(range(height - 7))
        assert set(places.x[among]) == set(range(width - 7))


def test_blur_reaches_over_the_edge_of_a_crop(recipe, monkeypatch):
    """A crop of the blurred picture, not a blurred crop: inside the picture every crop of a ramp is a ramp."""
    crops = Crops(Path(recipe.train), crop=8, scale=2, batch=1, seed=1, blur=1.0)
    ramp = np.broadcast_to(np.arange(60, dtype=np.uint8)[:, None] * 4, (60, 60, 3))
    monkeypatch.setattr(data.Photograph, "size", (60, 60))
    high = np.tile(ramp, (2, 2, 1))
    monkeypatch.setattr(data.Photograph, "crop", lambda self, rows, cols: Pair(ramp[rows, cols], high))
    low, _ = crops._corrupt_crop(crops.groups[0][0], 20, 20, np.random.default_rng(0))
    assert np.array_equal(low, ramp[20:24, 20:24])


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
        ({"noise": -1}, "noise: -1 is out of range; give 0 to 255"),
        ({"blur": 21}, "blur: 21 is out of range; give 0 to 20"),
        ({"jpeg": 101}, "jpeg: 101 is out of range; give 0 to 100"),
        ({"crop": 0}, "not a multiple of the scale 2"),
        ({"labelled": Path()}, "labelled pictures are of no use without labelled; add a share"),
        (
            {"labelled": Path(), "degradations": {"labelled": 1}, "scale": 4},
            "scale is 4, but labelled pictures are 2 times as large",
        ),
    ],
)
def test_wrong_arguments(recipe, given, message):
    with pytest.raises(ValueError, match=message):
        Crops(Path(recipe.train), **{"crop": 16, "scale": 2, "batch": 1, "seed": 9} | given)
