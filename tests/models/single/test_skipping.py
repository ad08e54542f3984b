"""Skipping doesn't change results: they equal those of the network on whole pictures."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.models import catalogue
from ciir.models.cards import Sizes
from ciir.models.single import skipping
from ciir.models.single.interpolation import Bicubic
from ciir.models.single.pixels import upscale_pixels
from ciir.models.single.skipping import SkipStatistics
from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene
from tests.models.stand_ins import IntegerNetwork

FLOAT = 1e-6
"""Largest difference of floats in [0, 1], as sums may be in another order; onnxruntime's don't differ here."""
NETWORKS = [
    entry.name
    for entry in catalogue.list_entries()
    if entry.name in ("fast", "fast-int8", "paper") and not entry.unsupported_reason
]


@st.composite
def pictures(draw):
    """Up to 5 pictures, some of them equal: one of two backgrounds with up to 3 rectangles of noise or of one colour,
    which may reach beyond the edges."""
    dtype = draw(st.sampled_from([np.uint8, np.uint16]))
    height, width, channels = draw(st.integers(1, 48)), draw(st.integers(1, 48)), draw(st.integers(1, 4))
    random = np.random.default_rng(draw(st.integers(0, 99)))

    def colour(shape=()):
        made = random.integers(0, np.iinfo(dtype).max, (*shape, channels), dtype, endpoint=True)
        if channels in (2, 4):
            made[..., -1] = random.choice([0, 1, np.iinfo(dtype).max], shape)  # clear, hardly there, opaque
        return made

    grounds = [colour(), colour()]
    made = []
    for _ in range(draw(st.integers(0, 4))):
        picture = np.tile(draw(st.sampled_from(grounds)), (height, width, 1))
        for _ in range(draw(st.integers(0, 3))):
            top, left = draw(st.integers(-4, height - 1)), draw(st.integers(-4, width - 1))
            part = picture[max(0, top) : top + draw(st.integers(1, 12)), max(0, left) : left + draw(st.integers(1, 12))]
            part[...] = colour(part.shape[:2]) if draw(st.booleans()) else colour()
        made.append(picture)
    order = draw(st.lists(st.sampled_from(range(len(made))), max_size=5)) if made else []
    return np.stack([made[number] for number in order]) if order else np.empty((0, height, width, channels), dtype)


@settings(max_examples=150)
@given(pictures(), st.sampled_from([3, 4]))
def test_skipping_gives_the_same_result(some, layers):
    statistics = SkipStatistics()
    got = upscale_pixels(IntegerNetwork(layers), some, statistics=statistics)
    np.testing.assert_array_equal(got, upscale_pixels(IntegerNetwork(layers), some, skip=False))
    assert statistics.pixels == some.shape[0] * some.shape[1] * some.shape[2]
    assert statistics.uniform >= 0
    assert statistics.uniform <= statistics.pixels


def make_on_grey(height, width, *parts):
    """A grey picture with noise in `parts`."""
    picture = np.full((1, height, width, 3), 90, np.uint8)
    for part in parts:
        shape = picture[0][part].shape
        picture[0][part] = np.random.default_rng(0).integers(0, 256, shape)
    return picture


def test_a_radius_that_is_too_small_shows():
    picture = make_on_grey(40, 40, np.s_[16:20, 15:22])
    whole = upscale_pixels(IntegerNetwork(4), picture)
    assert np.array_equal(upscale_pixels(IntegerNetwork(4), picture, skip=False), whole)
    assert not np.array_equal(upscale_pixels(IntegerNetwork(4, radius=3), picture), whole)


@pytest.mark.parametrize(
    ("part", "computed"),
    [
        (np.s_[30:31, 20:21], 13 * 13),
        (np.s_[:4, 20:30], 10 * 22),
        (np.s_[56:, 69:], 10 * 17),
        (np.s_[:0, :0], 0),
    ],
    ids=["a pixel", "at an edge", "in a corner", "nothing"],
)
def test_only_what_sees_a_difference_is_computed(part, computed):
    network, statistics = IntegerNetwork(), SkipStatistics()
    picture = make_on_grey(60, 80, part)
    upscale_pixels(network, picture, statistics=statistics)  # the first call also computes the pattern
    pixels = network.pixels
    upscale_pixels(network, picture)
    assert network.pixels - pixels == computed
    assert statistics.uniform == 60 * 80 - computed


def test_distant_objects_have_separate_boxes():
    network, parts = IntegerNetwork(), (np.s_[5:25, 5:25], np.s_[150:180, 160:195])
    picture, statistics = make_on_grey(200, 200, *parts), SkipStatistics()
    got = upscale_pixels(network, picture, statistics=statistics)
    assert 200 * 200 - statistics.uniform == (25 + 6) ** 2 + 42 * (35 + 11)
    np.testing.assert_array_equal(got, upscale_pixels(network, picture, skip=False))


def test_skip_false_skips_nothing():
    network, statistics = IntegerNetwork(), SkipStatistics()
    same = np.repeat(make_on_grey(30, 30), 3, axis=0)
    upscale_pixels(network, same, skip=False, statistics=statistics)
    assert network.pixels == statistics.pixels == 3 * 900
    assert statistics.uniform == 0


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        (Sizes(), False),
        (Sizes(minimum=7), True),
        (Sizes(minimum=1, multiple_of=2), False),
        (Sizes(minimum=1, square=True), False),
    ],
)
def test_networks_that_pad_pictures_skip_nothing(sizes, expected):
    """A small picture of one colour wouldn't give the result for a large one."""
    network = IntegerNetwork(3)
    network.card = type("Card", (), {"sizes": sizes})
    assert skipping.can_skip(network) is expected
    assert not skipping.can_skip(Bicubic(2))


@cache
def render_view(name):
    """The middle view of 64x64 lenses, with a margin of background, `(112, 112, 3)`."""
    array = LensArray(64, 64, 15, 15)
    placed = load_scene(name).transform(frame_scene(load_scene(name), array))
    (view,) = RaytraceBackend().render_views(placed, array, [(7, 7)], samples=1)
    return np.pad(view[..., :3], ((24, 24), (24, 24), (0, 0)), mode="edge")


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("of", ["vase", "globe", "hamburger"])
def test_rendered_views_are_the_same(name, of):
    network, statistics = catalogue.load_upscaler(name), SkipStatistics()
    for dtype, factor in ((np.uint8, 1), (np.uint16, 257)):
        some = render_view(of)[np.newaxis].astype(dtype) * dtype(factor)
        got = upscale_pixels(network, some, statistics=statistics)
        want = upscale_pixels(network, some, skip=False)
        np.testing.assert_allclose(got.astype(int), want.astype(int), rtol=0, atol=0 if "int8" in name else 1)
    assert statistics.uniform > 0


@pytest.mark.parametrize("name", NETWORKS)
def test_floats_are_the_same(name):
    network, view = catalogue.load_upscaler(name), render_view("globe").copy()
    view[(view == view[0, 0]).all(axis=2)] = [10, 200, 91]  # zero would equal the padding
    colour, boxes = skipping.find_boxes(view, network.radius)
    whole = network(to_floats(view))
    made = np.empty((*whole.shape[2:], 3), np.float32)
    side = 2 * network.radius + 1
    pattern = network(to_floats(np.tile(colour, (side, side, 1))))[0].transpose(1, 2, 0)
    skipping.fill_with_pattern(made, pattern, network.radius, network.scale)
    for box in boxes:
        part = network(to_floats(view[box.region]))[0].transpose(1, 2, 0)
        made[box.kept_in_picture(2)] = part[box.kept_in_tile(2)]
    np.testing.assert_allclose(made.transpose(2, 0, 1)[np.newaxis], whole, rtol=0, atol=FLOAT)


def to_floats(picture):
    return np.ascontiguousarray(picture.transpose(2, 0, 1)[np.newaxis]).astype(np.float32) / 255


@settings(max_examples=100)
@given(st.integers(20, 90), st.integers(20, 90), st.integers(1, 5), st.integers(0, 99))
def test_boxes_keep_everything_that_sees_a_difference(height, width, radius, seed):
    random = np.random.default_rng(seed)
    differs = random.random((height, width)) < random.choice([0, 0.0005, 0.003, 0.5])
    boxes = skipping.cover_with_boxes(differs, radius)
    if boxes is None:
        return
    reached = np.zeros((height + 2 * radius, width + 2 * radius), bool)
    for row, col in np.argwhere(differs):
        reached[row : row + 2 * radius + 1, col : col + 2 * radius + 1] = True
    kept = np.zeros((height, width), bool)
    for box in boxes:
        kept[box.kept] = True
        for region, good, length in zip(box.region, box.kept, (height, width), strict=True):
            assert region.start in (0, good.start - radius)
            assert region.stop in (length, good.stop + radius)
    assert kept[reached[radius:-radius, radius:-radius]].all()
    assert sum(skipping.count_pixels(box.region) for box in boxes) <= skipping.MAXIMUM_SHARE * height * width
