"""The shipped light-field networks on rendered views: they gain accuracy, do no harm, and keep the parallax."""

import dataclasses
from copy import copy
from functools import cache

import numpy as np
import pytest

from ciir.errors import InvalidImage
from ciir.models import catalogue
from ciir.models.light_field.planes import Range
from ciir.models.light_field.views import upscale_views
from ciir.models.light_field.windows import select_axis
from ciir.models.single.pixels import upscale_pixels
from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene
from ciir.training.evaluation.metrics import rgb_to_luma
from tests.models.light_field.parallax import estimate_disparities

NETWORKS = [entry.name for entry in catalogue.list_entries() if entry.is_light_field and not entry.unsupported_reason]
each_network = pytest.mark.parametrize("name", NETWORKS)
LENSES = 64
GRID = [(v, u) for v in range(5) for u in range(5)]
HARM = 0.2
"""Most dB that the neighbouring views may cost against the single-picture network."""


def render_views(name, refined, at, samples):
    """Views `at` of the middle 5x5, `(n, H, W, 3)`; lenses along each side: `LENSES` times `refined`."""
    array = LensArray(LENSES, LENSES, 15, 15)
    placed = load_scene(name).transform(frame_scene(load_scene(name), array))
    views = [(5 + v, 5 + u) for v, u in at]
    made = RaytraceBackend().render_views(placed, array.refine(refined), views, samples=samples)
    return np.stack([view[..., :3] for view in made])


@cache
def render_low(name, samples=1):
    return render_views(name, 1, GRID, samples).reshape(5, 5, LENSES, LENSES, 3)


@cache
def render_truth(name, at=(2, 2)):
    return render_views(name, 2, [at], 4)[0]


def upscale_view(model, views, at=(2, 2)):
    network = catalogue.load_light_field_network(model)
    given = {(v, u): views[v, u] for v, u in GRID}
    return upscale_views(network, catalogue.load_upscaler("fast"), given, [at], (5, 5))[0][0]


def compute_luma_psnr(picture, true):
    error = (rgb_to_luma(picture) - rgb_to_luma(true))[2:-2, 2:-2]
    return 10 * np.log10(255**2 / np.mean(error**2))


def compute_gain(name, views, true, at=(2, 2)):
    """Y-PSNR over that of `fast`, dB."""
    single = upscale_pixels(catalogue.load_upscaler("fast"), views[at][np.newaxis])[0]
    return compute_luma_psnr(upscale_view(name, views, at), true) - compute_luma_psnr(single, true)


@each_network
@pytest.mark.parametrize(("scene", "gain"), [("vase", 1.5), ("globe", 0.5), ("hamburger", 1.5)])
def test_matching_views_gain_more_than_a_larger_network(name, scene, gain):
    quality = upscale_pixels(catalogue.load_upscaler("quality"), render_low(scene)[2, 2][np.newaxis])[0]
    true = render_truth(scene)
    field = upscale_view(name, render_low(scene))
    assert compute_luma_psnr(field, true) - compute_luma_psnr(quality, true) >= gain


def replace_surroundings():
    views = render_low("hamburger", 4).copy()
    views[2, 2] = render_low("globe", 4)[2, 2]
    return views


def replace_half():
    views = render_low("globe", 4).copy()
    views[:, 3:] = render_low("hamburger", 4)[:, 3:]
    return views


def shift_views(shift):
    views = render_low("globe", 4).copy()
    for v, u in GRID:
        views[v, u] = np.roll(views[v, u], ((v - 2) * shift, (u - 2) * shift), (0, 1))
    return views


def add_noise(sigma):
    noise = np.random.default_rng(0).normal(0, sigma, (5, 5, LENSES, LENSES, 3))
    return np.clip(render_low("globe", 4) + noise, 0, 255).round().astype(np.uint8)


def shuffle_views():
    order = np.random.default_rng(1).permutation([slot for slot in range(25) if slot != 12]).tolist()
    flat = render_low("globe", 4).reshape(25, LENSES, LENSES, 3)
    return flat[[*order[:12], 12, *order[12:]]].reshape(5, 5, LENSES, LENSES, 3)


MISMATCHES = {
    "another scene around": replace_surroundings,
    "half of another scene": replace_half,
    "shifted by 3": lambda: shift_views(3),
    "shifted by 8": lambda: shift_views(8),
    "noise of 10 levels": lambda: add_noise(10),
    "noise of 40 levels": lambda: add_noise(40),
    "in random order": shuffle_views,
}


@each_network
@pytest.mark.parametrize("case", MISMATCHES)
def test_views_that_do_not_match_do_no_harm(name, case):
    views, true = MISMATCHES[case](), render_truth("globe")
    assert compute_gain(name, views, true) >= -HARM


@each_network
def test_pure_noise_does_no_harm(name):
    random = np.random.default_rng(2)
    true = random.integers(0, 256, (2 * LENSES, 2 * LENSES, 3)).astype(np.uint8)
    views = random.integers(0, 256, (5, 5, LENSES, LENSES, 3)).astype(np.uint8)
    views[2, 2] = true.reshape(LENSES, 2, LENSES, 2, 3).mean((1, 3)).round()
    assert compute_gain(name, views, true) >= -HARM


@each_network
@pytest.mark.parametrize("corner", [(0, 0), (0, 4), (4, 4)])
def test_views_gain_at_the_corners_of_the_grid_too(name, corner):
    """There windows have 9 views, not 25, and gain less: docs/benchmarks.md."""
    assert compute_gain(name, render_low("globe"), render_truth("globe", corner), corner) >= 0.3


@each_network
@pytest.mark.parametrize("axis", [0, 1])
def test_parallax_is_kept(name, axis):
    """The disparity from the middle view to the next equals the truth's to a twentieth of a pixel."""
    other = (3, 2) if axis == 0 else (2, 3)
    made = [rgb_to_luma(upscale_view(name, render_low("globe", 4), at)) for at in ((2, 2), other)]
    true = [rgb_to_luma(render_truth("globe", at)) for at in ((2, 2), other)]
    far = np.abs(estimate_disparities(*made, axis) - estimate_disparities(*true, axis))
    found = far[np.isfinite(far)]
    assert len(found) >= 10
    assert np.median(found) <= 0.05
    assert np.quantile(found, 0.9) <= 0.15


@each_network
def test_tiled_equals_whole(name, monkeypatch):
    whole = upscale_view(name, render_low("globe"))
    monkeypatch.setattr("ciir.models.light_field.runner.TILE_PIXELS", 80 * 80)
    tiled = upscale_view(name, render_low("globe"))
    assert np.abs(tiled.astype(int) - whole).max() <= 1  # float sums in another order, then rounded


@each_network
def test_any_grid(name):
    """Down to a single view."""
    network = catalogue.load_light_field_network(name)
    for grid in ((1, 1), (1, 3), (3, 3), (2, 5)):
        views = {(v, u): render_low("globe")[v, u] for v in range(grid[0]) for u in range(grid[1])}
        got, _ = upscale_views(network, catalogue.load_upscaler("fast"), views, list(views), grid)
        assert got.shape == (len(views), 2 * LENSES, 2 * LENSES, 3)


@pytest.mark.parametrize("at", [(2, 2), (0, 1), (1, 4)])
def test_two_runs_are_the_mean_of_one_and_of_a_mirrored_one_with_planes_between(at):
    network = catalogue.load_light_field_network("field-quality")
    assert network.card.runs == 2
    views = render_low("vase")[:4].astype(np.float32) / 255  # four rows: the last of a window is absent
    side = 24
    image = views[at][20 : 20 + side, 20 : 20 + side].transpose(2, 0, 1)[None]

    def run(network, image, grid, at, disparities):
        rows, cols = select_axis(at[0], 4), select_axis(at[1], 5)
        around = grid[:, :, 20 : 20 + side, 20 : 20 + side].mean(4)[np.ix_(rows.views, cols.views)]
        return network(image, around.reshape(1, 25, side, side), rows, cols, disparities)

    both = run(network, image, views, at, Range(-1.0, 1.0))
    once = copy(network)
    once.card = dataclasses.replace(network.card, runs=1)
    half = 1 / 11  # of the distance of 12 planes over two pixels
    first = run(once, image, views, at, Range(-1 - half, 1.0))
    start = LENSES - 20 - side  # of the same part in mirrored views
    flipped = np.roll(views[:, ::-1, :, ::-1], 20 - start, axis=3)
    second = run(once, image[..., ::-1], flipped, (at[0], 4 - at[1]), Range(-1.0, 1 + half))
    for mean, one, other in zip(both, first, second, strict=True):
        np.testing.assert_allclose(mean, (one + other[..., ::-1]) / 2, atol=1e-6)
        assert np.abs(one - other[..., ::-1]).max() > 1e-3


@each_network
@pytest.mark.parametrize(
    ("corrupt", "message"),
    [
        (lambda a: a[:, :24], r"give float32 of \(1, 25, 9, 8\)"),
        (lambda a: a.astype(np.float64), "neighbouring views of float64"),
        (lambda a: a + 0.5, r"out of range; give them in \[0, 1\]"),
        (lambda a: a * np.float32("nan"), "not finite"),
    ],
)
def test_windows_of_another_shape_or_range_are_refused(name, corrupt, message):
    image, around = np.zeros((1, 3, 9, 8), np.float32), np.full((1, 25, 9, 8), 0.6, np.float32)
    middle = select_axis(2, 5)
    with pytest.raises(InvalidImage, match=message):
        catalogue.load_light_field_network(name)(image, corrupt(around), middle, middle, Range(-1.0, 1.0))
