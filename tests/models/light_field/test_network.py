"""The shipped light-field networks on rendered views: they gain, do no harm, and keep the parallax."""

from functools import cache

import numpy as np
import pytest

from ciir.benchmarks.parallax import disparities
from ciir.errors import InvalidImage
from ciir.models import catalogue
from ciir.models.light_field.views import upscale_views
from ciir.models.light_field.windows import select_axis
from ciir.models.single.pixels import upscale_pixels
from ciir.renderer.backends.embree import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene
from ciir.training.evaluation.metrics import rgb_to_luma

FIELDS = [entry.name for entry in catalogue.list_entries() if entry.is_light_field and not entry.unsupported_reason]
each_field = pytest.mark.parametrize("name", FIELDS)
LENSES = 64
GRID = [(v, u) for v in range(5) for u in range(5)]
HARM = 0.2
"""Most dB that the views around may cost against the single-picture network."""


def seen(name, refined, at, samples):
    """Views of the middle 5x5, `(n, H, W, 3)`, by `LENSES` lenses along each side or `refined` times as many."""
    array = LensArray(LENSES, LENSES, 15, 15)
    placed = load_scene(name).transform(frame_scene(load_scene(name), array))
    views = [(5 + v, 5 + u) for v, u in at]
    made = RaytraceBackend().render_views(placed, array.refine(refined), views, samples=samples)
    return np.stack([view[..., :3] for view in made])


@cache
def low(name, samples=1):
    return seen(name, 1, GRID, samples).reshape(5, 5, LENSES, LENSES, 3)


@cache
def truth(name, at=(2, 2)):
    return seen(name, 2, [at], 4)[0]


def upscaled(model, views, at=(2, 2)):
    network = catalogue.load_light_field_network(model)
    return upscale_views(
        network, catalogue.load_upscaler("fast"), {(v, u): views[v, u] for v, u in GRID}, [at], (5, 5)
    )[0][0]


def score(picture, true):
    error = (rgb_to_luma(picture) - rgb_to_luma(true))[2:-2, 2:-2]
    return 10 * np.log10(255**2 / np.mean(error**2))


def fast(view):
    return upscale_pixels(catalogue.load_upscaler("fast"), view[np.newaxis])[0]


@each_field
@pytest.mark.parametrize(("of", "worth"), [("vase", 1.5), ("globe", 0.5), ("hamburger", 1.5)])
def test_views_that_help_are_worth_more_than_a_larger_network(name, of, worth):
    quality = upscale_pixels(catalogue.load_upscaler("quality"), low(of)[2, 2][np.newaxis])[0]
    gain = score(upscaled(name, low(of)), truth(of)) - score(quality, truth(of))
    assert gain >= worth


def another_scene():
    views = low("hamburger", 4).copy()
    views[2, 2] = low("globe", 4)[2, 2]
    return views


def half_another_scene():
    views = low("globe", 4).copy()
    views[:, 3:] = low("hamburger", 4)[:, 3:]
    return views


def moved(shift):
    views = low("globe", 4).copy()
    for v, u in GRID:
        views[v, u] = np.roll(views[v, u], ((v - 2) * shift, (u - 2) * shift), (0, 1))
    return views


def noisy(sigma):
    noise = np.random.default_rng(0).normal(0, sigma, (5, 5, LENSES, LENSES, 3))
    return np.clip(low("globe", 4) + noise, 0, 255).round().astype(np.uint8)


def shuffled():
    order = np.random.default_rng(1).permutation([slot for slot in range(25) if slot != 12]).tolist()
    flat = low("globe", 4).reshape(25, LENSES, LENSES, 3)
    return flat[[*order[:12], 12, *order[12:]]].reshape(5, 5, LENSES, LENSES, 3)


HARMFUL = {
    "another scene around": another_scene,
    "half of another scene": half_another_scene,
    "moved by 3": lambda: moved(3),
    "moved by 8": lambda: moved(8),
    "noise of 10 levels": lambda: noisy(10),
    "noise of 40 levels": lambda: noisy(40),
    "in no order": shuffled,
}


@each_field
@pytest.mark.parametrize("case", HARMFUL)
def test_views_that_do_not_match_do_no_harm(name, case):
    views, true = HARMFUL[case](), truth("globe")
    assert score(upscaled(name, views), true) >= score(fast(views[2, 2]), true) - HARM


@each_field
def test_pure_noise_does_no_harm(name):
    random = np.random.default_rng(2)
    true = random.integers(0, 256, (2 * LENSES, 2 * LENSES, 3)).astype(np.uint8)
    views = random.integers(0, 256, (5, 5, LENSES, LENSES, 3)).astype(np.uint8)
    views[2, 2] = true.reshape(LENSES, 2, LENSES, 2, 3).mean((1, 3)).round()
    assert score(upscaled(name, views), true) >= score(fast(views[2, 2]), true) - HARM


@each_field
@pytest.mark.parametrize("corner", [(0, 0), (0, 4), (4, 4)])
def test_views_help_at_the_corners_of_the_grid_too(name, corner):
    """With 9 views in place of 25 they help less: docs/benchmarks.md."""
    true = truth("globe", corner)
    assert score(upscaled(name, low("globe"), corner), true) >= score(fast(low("globe")[corner]), true) + 0.3


@each_field
@pytest.mark.parametrize("axis", [0, 1])
def test_parallax_is_kept(name, axis):
    """Disparity from the middle view to the next is the truth's to a twentieth of a pixel."""
    other = (3, 2) if axis == 0 else (2, 3)
    made = [rgb_to_luma(upscaled(name, low("globe", 4), at)) for at in ((2, 2), other)]
    true = [rgb_to_luma(truth("globe", at)) for at in ((2, 2), other)]
    far = np.abs(disparities(*made, axis) - disparities(*true, axis))
    found = far[np.isfinite(far)]
    assert len(found) >= 10
    assert np.median(found) <= 0.05
    assert np.quantile(found, 0.9) <= 0.15


@each_field
def test_tiles_are_the_whole(name, monkeypatch):
    whole = upscaled(name, low("globe"))
    monkeypatch.setattr("ciir.models.light_field.views.WINDOW", 48 * 48)
    tiled = upscaled(name, low("globe"))
    assert np.abs(tiled.astype(int) - whole).max() <= 1  # float sums in another order, then rounded


@each_field
def test_one_view_and_a_few_go_through(name):
    """Any grid: what isn't there plays no part. A view alone is upscaled too, if not as `fast` would."""
    network = catalogue.load_light_field_network(name)
    for grid in ((1, 1), (1, 3), (3, 3), (2, 5)):
        views = {(v, u): low("globe")[v, u] for v in range(grid[0]) for u in range(grid[1])}
        got, _ = upscale_views(network, catalogue.load_upscaler("fast"), views, list(views), grid)
        assert got.shape == (len(views), 2 * LENSES, 2 * LENSES, 3)


@each_field
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda a: a[:, :24], r"give float32 of \(1, 25, 9, 8\)"),
        (lambda a: a.astype(np.float64), "views around of float64"),
        (lambda a: a + 0.5, r"out of range; give them in \[0, 1\]"),
        (lambda a: a * np.float32("nan"), "not finite"),
    ],
)
def test_windows_of_another_shape_or_range_are_refused(name, spoil, words):
    image, around = np.zeros((1, 3, 9, 8), np.float32), np.full((1, 25, 9, 8), 0.6, np.float32)
    there = select_axis(2, 5).present
    with pytest.raises(InvalidImage, match=words):
        catalogue.load_light_field_network(name)(image, spoil(around), there, there)
