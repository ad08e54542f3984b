"""What makes views differ, one cause at a time."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.data.light_field import camera_differences, grey_jpeg
from ciir.training.data.light_field.camera_differences import compute_luma, differ
from ciir.training.data.light_field.layered_scenes import LUMA

NONE = {
    "MISMATCHED": 0.0,
    "NOISE": (0.0, 0.1),
    "GRAIN": (0.0, 0.1),
    "BRIGHTNESS": (0.0, 0.1, 0.1),
    "BLUR": (0.0, 0.1),
    "JPEG": (0.0, 0.0, 50),
}
OWN = (1, 3)
NUMBER = 5 * OWN[0] + OWN[1]
OTHERS = [number for number in range(25) if number != NUMBER]


@pytest.fixture
def only(monkeypatch):
    """Sets the shares of all causes but the given ones to 0."""

    def set_to(**causes):
        for name, value in (NONE | causes).items():
            monkeypatch.setattr(camera_differences, name, value)

    return set_to


def make_crops(count=4, side=16):
    """Smooth pictures between 0.2 and 0.8, and windows whose views are all like the picture."""
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, (count, 3, 1, 1))
    y, x = np.mgrid[:side, :side]
    image = torch.from_numpy(0.5 + 0.15 * (np.sin(y / 2 + phase) + np.sin(x / 3 - phase))).float()
    return image, compute_luma(image).expand(-1, 25, -1, -1).clone()


def run(image, around, seed=0, ease=1.0):
    return differ(np.random.default_rng(seed), image.clone(), around.clone(), OWN, ease)


def test_changes_depend_only_on_the_generator():
    image, around = make_crops(32)
    one, again, other = (run(image, around, seed) for seed in (0, 0, 1))
    assert all(torch.equal(a, b) for a, b in zip(one, again, strict=True))
    assert not torch.equal(one[1], other[1])
    assert not torch.equal(one[1], around)


@pytest.mark.parametrize("ease", [0.0, 1.0])
def test_shares_of_0_change_nothing(only, ease):
    image, around = make_crops(32)
    if ease:
        only()
    found, window = run(image, around, ease=ease)
    torch.testing.assert_close(found, image, atol=1e-6, rtol=0)
    assert torch.equal(window[:, OTHERS], around[:, OTHERS])
    torch.testing.assert_close(window[:, NUMBER], around[:, NUMBER], atol=1e-6, rtol=0)


@pytest.mark.parametrize("seed", range(4))
def test_the_view_stays_the_one_in_its_window(seed):
    found, window = run(*make_crops(16), seed)
    torch.testing.assert_close(window[:, NUMBER : NUMBER + 1], compute_luma(found), atol=1e-6, rtol=0)
    for part in (found, window):
        assert 0 <= part.min() <= part.max() <= 1


def test_grain_is_independent_between_views(only):
    only(GRAIN=(1.0, 0.1))
    found, window = run(torch.full((4, 3, 40, 40), 0.5), torch.full((4, 25, 40, 40), 0.5))
    strength = found.std((1, 2, 3))
    assert (strength.min() > 0.001, strength.max() < 0.105) == (True, True)
    ratio = window[:, OTHERS].std((2, 3)) / strength[:, None]
    assert (ratio / np.linalg.norm(LUMA) - 1).abs().max() < 0.15  # of 1600 samples each
    noise = window[:, OTHERS].flatten(2) - 0.5
    alike = torch.stack([torch.corrcoef(one) for one in noise]) - torch.eye(24)
    assert alike.abs().max() < 0.15


def test_mismatched_views_are_of_another_scene(only):
    only(MISMATCHED=1.0)
    level = torch.tensor([0.2, 0.5, 0.8])[:, None, None, None]
    found, window = run(level.expand(3, 3, 4, 4), level.expand(3, 25, 4, 4))
    torch.testing.assert_close(found, level.expand(3, 3, 4, 4))
    assert torch.equal(window[:, OTHERS], level[:, :, 0].roll(1, 0)[..., None].expand(3, 24, 4, 4))


def test_brightness_changes_steadily_over_the_window(only):
    """By one step for each row and one for each column of views; the view itself is as it was."""
    only(BRIGHTNESS=(1.0, 0.05, 0.0))
    found, window = run(torch.full((8, 3, 4, 4), 0.4), torch.full((8, 25, 4, 4), 0.4))
    torch.testing.assert_close(found, torch.full((8, 3, 4, 4), 0.4))
    torch.testing.assert_close(window, window[..., :1, :1].expand_as(window))
    factors = (window[:, :, 0, 0] / 0.4).unflatten(1, (5, 5))
    torch.testing.assert_close(factors[:, OWN[0], OWN[1]], torch.ones(8))
    for axis in (1, 2):
        steps = factors.diff(dim=axis)
        torch.testing.assert_close(steps, steps[:, :1, :1].expand_as(steps), atol=1e-5, rtol=0)
        assert 0.01 < steps.abs().max() <= 0.05 + 1e-6


def test_blur_differs_between_views_and_keeps_the_mean(only):
    only(BLUR=(1.0, 0.2))
    image = torch.zeros(2, 3, 9, 9)
    image[..., 4, 4] = 1.0
    found, window = run(image, compute_luma(image).expand(-1, 25, -1, -1))
    torch.testing.assert_close(found, image)
    torch.testing.assert_close(window.sum((2, 3)), torch.ones(2, 25))
    peaks = window[:, OTHERS, 4, 4]
    assert peaks.min() > (1 - 2 * 0.2) ** 2
    assert peaks.std(1).min() > 0.05
    assert window[:, OTHERS, 4, 3].min() > 0
    torch.testing.assert_close(window[:, :, 4, 3], window[:, :, 5, 4])


@pytest.mark.parametrize("is_array", [False, True])
def test_jpeg_of_views_and_of_elemental_images(is_array):
    """A change of one view reaches the others only where the pixels of a lens are next to each other."""
    views = torch.from_numpy(np.random.default_rng(1).uniform(0.3, 0.7, (2, 25, 16, 24))).float()
    other, qualities = views.clone(), torch.tensor([70, 95])
    other[0, 7] = 1 - other[0, 7]
    one, two = (camera_differences._compress(each, qualities, is_array=is_array) for each in (views, other))
    assert one.shape == views.shape
    assert 0.001 < (one - views)[1].abs().mean() < (one - views)[0].abs().mean() < 0.06
    changed = (one != two).flatten(2).any(2)
    assert changed[0, 7]
    assert changed.sum(1).tolist() == [25 if is_array else 1, 0]


@pytest.mark.parametrize("is_array", [False, True])
def test_jpeg_is_of_the_whole_array(is_array):
    """Against the picture that the array is, row by row in loops, compressed by itself."""
    height, width = 6, 10
    views = torch.from_numpy(np.random.default_rng(2).integers(0, 256, (1, 25, height, width))).float()
    array = torch.zeros(5 * height, 5 * width)
    for view in range(25):
        v, u = divmod(view, 5)
        part = (
            (slice(v, None, 5), slice(u, None, 5))
            if is_array
            else (slice(v * height, (v + 1) * height), slice(u * width, (u + 1) * width))
        )
        array[part] = views[0, view]
    (wanted,) = grey_jpeg.compress(array[None], torch.tensor([60]))
    (found,) = camera_differences._compress(views / 255, torch.tensor([60]), is_array=is_array) * 255
    for view in range(25):
        v, u = divmod(view, 5)
        part = wanted[v::5, u::5] if is_array else wanted[v * height :, u * width :][:height, :width]
        torch.testing.assert_close(found[view], part, atol=1e-3, rtol=0)


def test_shares_of_jpeg(only):
    image, around = make_crops()
    results = []
    for shares in ((1.0, 0.0), (0.0, 1.0)):
        only(JPEG=(*shares, 60))
        found, window = run(image, around)
        results.append(window)
        assert 0 < (window - around).abs().max() < 0.2
        assert 0 < (found - image).abs().max() < 0.2
    assert not torch.equal(*results)
