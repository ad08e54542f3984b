import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from ciir.models.light_field.fusion import matching
from ciir.models.light_field.fusion.matching import Seen, match_views

AROUND = [(0, 1), (1, 0), (0, -1), (-1, 0)]
SAMPLINGS = pytest.mark.parametrize("sampling", ["filter", "means"])


def make_texture(side, *, down=0.0, right=0.0):
    """Waves up to the finest that the upscaled picture shows, moved by LR pixels, with a contrast of about 1."""
    random = np.random.default_rng(0)
    places = np.arange(side, dtype=float)
    total = np.zeros((side, side))
    for _ in range(60):
        fy, fx = random.uniform(-1.9, 1.9, 2)  # views show waves up to pi / 2
        phase = random.uniform(0, 6)
        total += np.cos(fy * (places[:, None] - 2 * down) + fx * (places - 2 * right) + phase)
    return (total / 12).astype(np.float32)


def downscale(picture, sampling):
    image = Image.fromarray(picture)
    way = Image.Resampling.BICUBIC if sampling == "filter" else Image.Resampling.BOX
    return np.asarray(image.resize((picture.shape[1] // 2, picture.shape[0] // 2), way))


def upscale(picture):
    image = Image.fromarray(picture)
    return np.asarray(image.resize((2 * picture.shape[1], 2 * picture.shape[0]), Image.Resampling.BICUBIC))


def see(offsets, sampling, *, side=64, disparity=0.0, shift=(0.0, 0.0)):
    """Returns a view and those around it of a plane that moves by `disparity`, which lie `shift` off."""
    flat = np.full((side // 2, side // 2), disparity, np.float32)
    lumas = {}
    for v, u in [(0, 0), *offsets]:
        down, right = (disparity * k + (by if (v, u) != (0, 0) else 0) for k, by in zip((v, u), shift, strict=True))
        lumas[v, u] = Seen(downscale(make_texture(side, down=down, right=right), sampling), flat)
    return lumas.pop((0, 0)), lumas


def measure_error(picture, truth):
    return float(np.sqrt(np.mean(np.square(picture - truth)[8:-8, 8:-8])))


@SAMPLINGS
def test_moved_views_show_what_one_does_not(sampling):
    own, others = see(AROUND, sampling, disparity=0.75)
    first, truth = upscale(own.luma), make_texture(64)
    alone = match_views(first, own, {}, sampling)
    matched = match_views(first, own, others, sampling)
    assert measure_error(matched, truth) < 0.93 * measure_error(alone, truth)
    assert measure_error(alone, truth) < measure_error(first, truth)


@SAMPLINGS
def test_equals_a_slow_reference(sampling, monkeypatch):
    """Rounds of back-projection with the exact motion of a plane, in whole pixels of the upscaled picture."""
    monkeypatch.setattr(matching, "SOFT", np.float32(1e9))
    monkeypatch.setattr(matching, "DEVIATION", 1e9)
    monkeypatch.setattr(matching, "PRIOR", 0.0)
    monkeypatch.setattr(matching, "WIENER", 1e9)  # no sharpening
    monkeypatch.setattr(matching, "AROUND", 63)  # brightness of the whole view
    own, others = see([(0, 1), (-1, 0)], sampling, disparity=0.5)
    first = upscale(own.luma)
    picture = first.astype(np.float64)
    for _ in range(matching.ROUNDS):
        change, weights = np.zeros_like(picture), 0.0
        for (v, u), seen in {(0, 0): own, **others}.items():
            moved = np.roll(picture, (v, u), (0, 1)).astype(np.float32)  # half an LR pixel a view
            difference = seen.luma - downscale(moved, sampling)
            back = np.asarray(Image.fromarray(difference).resize((64, 64), Image.Resampling.BILINEAR))
            weight = matching.OWN_WEIGHT if (v, u) == (0, 0) else 1
            change += weight * np.roll(back, (-v, -u), (0, 1))
            weights += weight
        picture += change / weights
    got = match_views(first, own, others, sampling)
    inside = np.s_[12:-12, 12:-12]  # roll wraps around
    # The reference samples the filtered picture exactly; between its pixels ours is a cubic convolution.
    np.testing.assert_allclose(got[inside], picture[inside], atol=0.04)
    assert np.abs(picture - first)[inside].max() > 0.2


def test_views_that_lie_off_are_found():
    own, others = see([(0, 1), (1, 0)], "filter", disparity=0.5, shift=(0.3, -0.2))
    for offset, seen in others.items():
        np.testing.assert_allclose(
            matching._find_shift(own, seen.luma, offset), (0.3, -0.2), atol=0.12
        )  # these views are aliased


def test_views_that_lie_off_help(monkeypatch):
    own, others = see(AROUND, "means", disparity=0.5, shift=(0.3, -0.2))
    first, truth = upscale(own.luma), make_texture(64)
    found = measure_error(match_views(first, own, others, "means"), truth)
    monkeypatch.setattr(matching, "_find_shift", lambda own, other, offset: np.zeros(2, np.float32))
    assert found < 0.97 * measure_error(match_views(first, own, others, "means"), truth)


def test_single_pixels_that_differ_hardly_count():
    own, others = see(AROUND, "means", disparity=0.5)
    first = upscale(own.luma)
    expected = match_views(first, own, others, "means")
    spot = np.zeros_like(own.luma)
    spot[16, 16] = 0.3  # too little to tell other content by its patch
    spotted = {offset: seen._replace(luma=seen.luma + spot) for offset, seen in others.items()}
    change = np.abs(match_views(first, own, spotted, "means") - expected)
    assert change.max() < 0.05  # of 0.3; 0.08 if each counted by its difference


def test_noise_in_flat_parts_is_held_back(monkeypatch):
    random = np.random.default_rng(0)
    flat = np.zeros((32, 32), np.float32)
    own, *others = (Seen(random.normal(0, 0.03, flat.shape).astype(np.float32), flat) for _ in range(5))
    first = np.zeros((64, 64), np.float32)
    given = dict(zip(AROUND, others, strict=True))
    held = np.std(match_views(first, own, given, "filter"))
    monkeypatch.setattr(matching, "PRIOR", 0.0)
    assert held < 0.7 * np.std(match_views(first, own, given, "filter"))


@SAMPLINGS
def test_views_of_other_content_hardly_count(sampling):
    own, _ = see([], sampling)
    first = upscale(own.luma)
    random = np.random.default_rng(1)
    others = {offset: Seen(random.normal(0, 1, own.luma.shape).astype(np.float32), own.disparity) for offset in AROUND}
    alone = match_views(first, own, {}, sampling)
    np.testing.assert_allclose(match_views(first, own, others, sampling), alone, atol=0.02)


def test_brightness_stays_that_of_the_view():
    own, others = see(AROUND, "means", disparity=0.5)
    brighter = {offset: seen._replace(luma=seen.luma + np.float32(0.5)) for offset, seen in others.items()}
    first = upscale(own.luma)
    got, expected = (match_views(first, own, some, "means") for some in (brighter, others))
    np.testing.assert_allclose(got, expected, atol=1e-4)


def test_differences_of_the_size_of_noise_are_left():
    own, others = see(AROUND, "filter", disparity=0.5)
    first = upscale(own.luma)
    full, quiet = (match_views(first, own, others, "filter", noise=noise) for noise in (0.0, 10.0))
    assert np.abs(quiet - first).max() < 0.02 * np.abs(full - first).max()


def test_strips_make_little_difference(monkeypatch):
    own, others = see(AROUND, "filter", disparity=-0.75, side=128)
    first = upscale(own.luma)
    whole = match_views(first, own, others, "filter")
    monkeypatch.setattr(matching, "FEWEST_ROWS", 20)
    monkeypatch.setattr(matching, "STRIP_PIXELS", 0)
    got = match_views(first, own, others, "filter")
    assert np.abs(whole - first).max() > 0.2
    np.testing.assert_allclose(got, whole, atol=0.02)
    np.testing.assert_array_equal(match_views(first, own, others, "filter", cores=2), got)


@settings(deadline=None)
@given(
    size=st.tuples(st.integers(1, 12), st.integers(1, 12)),
    level=st.floats(0, 3, width=32),
    disparity=st.floats(-20, 20, width=32),
    scale=st.integers(2, 4),
    sampling=st.sampled_from(["filter", "means"]),
)
def test_flat_views_of_any_size_stay(size, level, disparity, scale, sampling):
    height, width = size
    flat = np.full(size, level, np.float32)
    seen = Seen(flat, np.full_like(flat, disparity))
    picture = np.full((scale * height, scale * width), level, np.float32)
    got = match_views(picture, seen, dict.fromkeys(AROUND, seen), sampling)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, picture, atol=1e-4)


@pytest.mark.parametrize(("sampling", "way"), [("filter", Image.Resampling.BICUBIC), ("means", Image.Resampling.BOX)])
@pytest.mark.parametrize("scale", [2, 3, 4])
def test_the_filter_is_that_of_downscaling(sampling, way, scale):
    weights = matching._make_filter(sampling, scale)
    line = np.random.default_rng(0).random((1, 20 * scale), np.float32)
    small = np.asarray(Image.fromarray(line).resize((20, 1), way))
    first = 10 * scale - (len(weights) - scale) // 2
    assert small[0, 10] == pytest.approx(line[0, first:][: len(weights)] @ weights, abs=1e-6)
