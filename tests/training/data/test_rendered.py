"""Pairs of rendered views: deterministic, aligned, and sampled as by each kind of array."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs torch, of the training extra")

from PIL import Image

from ciir import cores
from ciir.training.data import rendered
from ciir.training.data.crops import Crops
from ciir.training.data.pictures import Pictures
from tests.training import degradations

SHARES = {"bicubic": 2, "pinhole": 1, "lenslet": 1}
PICTURES = [np.random.default_rng(i).integers(0, 256, (120, 90, 3), dtype=np.uint8) for i in range(3)]


def test_a_scene_depends_only_on_its_number():
    one, again, other = (rendered.render_pairs(PICTURES, seed=1, index=index) for index in (5, 5, 6))
    for first, second in zip(one, again, strict=True):
        np.testing.assert_array_equal(first[0], second[0])
        np.testing.assert_array_equal(first[1], second[1])
    assert not np.array_equal(one[0][1], other[0][1])


def test_scenes_do_not_depend_on_the_number_of_processes(tmp_path, monkeypatch):
    for index, picture in enumerate(PICTURES):
        Image.fromarray(picture).save(tmp_path / f"{index}.png")
    pictures = Pictures(tmp_path)
    monkeypatch.setattr(rendered, "SCENES_PER_PROCESS", 1)
    monkeypatch.setattr(cores, "count_available_cores", lambda: 2)
    seen = list(rendered.render_scenes(pictures, 3, seed=4))
    monkeypatch.setattr(cores, "count_available_cores", lambda: 1)
    for some, same in zip(seen, rendered.render_scenes(pictures, 3, seed=4), strict=True):
        for pair, twin in zip(some, same, strict=True):
            assert all(np.array_equal(a, b) for a, b in zip(pair, twin, strict=True))


@pytest.mark.parametrize("index", range(3))
def test_the_truth_is_aligned_with_the_views(index):
    (pinhole, truth), (lenslet, same) = rendered.render_pairs(PICTURES, seed=2, index=index)
    assert (pinhole.shape, lenslet.shape, truth.shape) == ((96, 96, 3), (96, 96, 3), (192, 192, 3))
    assert same is truth
    mean = truth.reshape(96, 2, 96, 2, 3).mean((1, 3))
    # A lens of the coarse array covers 2x2 of the fine one; 16 samples of it against 64 differ only at edges.
    aligned = np.abs(lenslet - mean).mean()
    assert aligned < 1.0
    for shifted in (np.roll(mean, 1, 0), np.roll(mean, 1, 1)):
        assert np.abs(lenslet - shifted).mean() > 3 * aligned
    assert np.abs(pinhole - mean).mean() > aligned


def test_crops_mix_photographs_and_views(tmp_path):
    for index, picture in enumerate(PICTURES):
        Image.fromarray(picture).save(tmp_path / f"{index}.png")
    crops = Crops(tmp_path, crop=32, scale=2, batch=8, seed=0, scenes=2, degradations=SHARES)
    assert [len(group) for group in crops.groups] == [3, 2, 2]
    assert crops.shares.tolist() == [0.5, 0.25, 0.25]
    low, high = crops.make_batch(7)
    assert (low.shape, high.shape) == ((8, 3, 16, 16), (8, 3, 32, 32))
    assert all((a == b).all() for a, b in zip(crops.make_batch(7), (low, high), strict=True))


def test_a_bicubic_view_is_the_truth_made_small(tmp_path):
    """The whole of it, so that nothing but rounding stands between LR and the bicubic LR of HR."""
    Image.fromarray(PICTURES[0]).save(tmp_path / "a.png")
    crops = Crops(tmp_path, crop=192, scale=2, batch=2, seed=0, scenes=1, degradations={"bicubic-view": 1})
    low, high = crops.make_batch(0)
    assert ((degradations.bicubic(high, 2) - low).abs() * 255).max() <= 1.01
    pinhole, _ = Crops(tmp_path, crop=192, scale=2, batch=2, seed=0, scenes=1, degradations={"pinhole": 1}).make_batch(
        0
    )
    assert ((pinhole - low).abs() * 255).max() > 10
