"""Skipping doesn't change the results of light fields."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.models import catalogue
from ciir.models.light_field.views import upscale_views
from ciir.models.single import skipping
from ciir.models.single.skipping import SkipStatistics
from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene
from tests.models.light_field.disparities.measure import measure_shifts
from tests.models.stand_ins import IntegerLightFieldNetwork, IntegerNetwork

NETWORKS = [entry.name for entry in catalogue.list_entries() if entry.is_light_field and not entry.unsupported_reason]


def make_light_field(grid, shape, *, moves=1, seed=0, dtype=np.uint8, size=4, at=(6, 6)):
    """A square of noise at `at` in the middle view, on one colour, that moves by `moves` pixels per view."""
    random = np.random.default_rng(seed)
    most = np.iinfo(dtype).max
    ground, thing = (random.integers(0, most + 1, (*side, shape[2])).astype(dtype) for side in ((), (size, size)))
    views = {}
    for v in range(grid[0]):
        for u in range(grid[1]):
            view = np.tile(ground, (*shape[:2], 1))
            top, left = at[0] + moves * (v - grid[0] // 2), at[1] + moves * (u - grid[1] // 2)
            part = view[max(0, top) : max(0, top + size), max(0, left) : max(0, left + size)]
            part[...] = thing[max(0, -top) :, max(0, -left) :][: part.shape[0], : part.shape[1]]
            views[v, u] = view
    return views


def upscale_both_ways(network, views, wanted, grid, statistics=None):
    fallback = IntegerNetwork()
    skipped = upscale_views(network, fallback, views, wanted, grid, statistics=statistics)
    whole = upscale_views(network, fallback, views, wanted, grid, skip=False)
    return skipped, whole


@pytest.mark.parametrize("tile_pixels", [40 * 40, 65536])
def test_views_of_many_disparities_are_the_same_with_skipping_in_tiles_and_alone(monkeypatch, tile_pixels):
    """Two squares that move by 6 and -8 pixels per view before one colour: three shifts, each on its own boxes."""
    near, far = (
        make_light_field((5, 5), (120, 130, 1), moves=moves, at=at, size=32)
        for moves, at in ((6, (20, 24)), (-8, (62, 70)))
    )
    views = {view: np.where(near[view] != near[view][0, 64], near[view], far[view]) for view in near}
    views = {view: np.where(far[view] != far[view][0, 64], far[view], views[view]) for view in near}
    wanted = [(2, 2), (1, 3), (0, 2)]
    assert {-8, 0, 6} <= set(np.unique(measure_shifts(views, (2, 2), (5, 5))))
    network, fallback = IntegerLightFieldNetwork(), IntegerNetwork()
    alone = [upscale_views(network, fallback, views, [view], (5, 5), skip=False)[0][0] for view in wanted]
    monkeypatch.setattr("ciir.models.light_field.runner.TILE_PIXELS", tile_pixels)
    for skip in (True, False):
        statistics = SkipStatistics()
        got, _ = upscale_views(network, fallback, views, wanted, (5, 5), skip=skip, statistics=statistics)
        np.testing.assert_array_equal(got, alone)
        assert (0 < statistics.uniform < statistics.pixels) == skip


@settings(max_examples=60)
@given(
    st.data(),
    st.tuples(st.integers(1, 6), st.integers(1, 6)),
    st.tuples(st.integers(1, 30), st.integers(1, 30), st.sampled_from([1, 3])),
    st.tuples(st.integers(-2, 25), st.integers(-2, 25)),
    st.integers(-4, 4),
)
def test_skipping_gives_the_same_result(data, grid, shape, at, moves):
    dtype = data.draw(st.sampled_from([np.uint8, np.uint16]))
    views = make_light_field(grid, shape, moves=moves, at=at, dtype=dtype, seed=data.draw(st.integers(0, 9)))
    if data.draw(st.booleans()):  # another colour around some view
        views[data.draw(st.sampled_from(sorted(views)))][...] = 3
    wanted = data.draw(st.lists(st.sampled_from(sorted(views)), min_size=1, max_size=8))
    statistics = SkipStatistics()
    (got, made), (want, expected) = upscale_both_ways(IntegerLightFieldNetwork(), views, wanted, grid, statistics)
    np.testing.assert_array_equal(got, want)
    assert made == expected
    assert statistics.pixels == len(wanted) * shape[0] * shape[1]
    assert statistics.uniform <= statistics.pixels


def test_a_radius_that_is_too_small_shows():
    views = make_light_field((5, 5), (40, 40, 3), at=(18, 18))
    (got, _), (want, _) = upscale_both_ways(IntegerLightFieldNetwork(4), views, [(2, 2)], (5, 5))
    np.testing.assert_array_equal(got, want)
    (got, _), (want, _) = upscale_both_ways(IntegerLightFieldNetwork(4, radius=3), views, [(2, 2)], (5, 5))
    assert not np.array_equal(got, want)


@pytest.mark.parametrize("tile_pixels", [20 * 20, 65536])
@pytest.mark.parametrize("moves", [1, 5])
def test_a_views_result_depends_on_no_other_view_and_on_no_tile(monkeypatch, moves, tile_pixels):
    views = make_light_field((7, 7), (60, 64, 3), moves=moves, at=(24, 24), size=20)
    wanted = [(3, 3), (0, 0), (6, 2), (3, 4)]
    found = measure_shifts(views, (3, 3), (7, 7))
    assert set(np.unique(found)) == ({0, 4} if moves > 1 else {0})
    whole = [
        upscale_views(IntegerLightFieldNetwork(), IntegerNetwork(), views, [at], (7, 7), skip=False)[0][0]
        for at in wanted
    ]
    monkeypatch.setattr("ciir.models.light_field.runner.TILE_PIXELS", tile_pixels)
    statistics = SkipStatistics()
    got, _ = upscale_views(IntegerLightFieldNetwork(), IntegerNetwork(), views, wanted, (7, 7), statistics=statistics)
    np.testing.assert_array_equal(got, whole)
    assert statistics.uniform > 0


def test_the_box_covers_differences_in_every_view_of_the_window():
    views, network, statistics = (
        make_light_field((5, 5), (50, 60, 3), at=(20, 22)),
        IntegerLightFieldNetwork(is_confident=True),
        SkipStatistics(),
    )
    upscale_views(network, IntegerNetwork(), views, [(2, 2)], (5, 5), statistics=statistics)
    pixels = network.pixels
    upscale_views(network, IntegerNetwork(), views, [(2, 2)], (5, 5))
    box = 4 + 2 * 2 + 4 * 3  # the square, moving two pixels to each side, twice the radius
    assert network.pixels - pixels == box * box
    assert statistics.uniform == 50 * 60 - box * box


def test_skip_false_skips_nothing():
    views, network, statistics = (
        make_light_field((3, 3), (30, 30, 3), moves=0),
        IntegerLightFieldNetwork(is_confident=True),
        SkipStatistics(),
    )
    upscale_views(network, IntegerNetwork(), views, [(1, 1), (1, 1)], (3, 3), skip=False, statistics=statistics)
    assert network.pixels == statistics.pixels == 2 * 900
    assert statistics.uniform == 0


@cache
def render_views(margin):
    """Views of the vase, 5x5 of 48x48 pixels with at least `margin` pixels around them."""
    array = LensArray(48, 48, 15, 15)
    placed = load_scene("vase").transform(frame_scene(load_scene("vase"), array))
    at = [(v, u) for v in range(5, 10) for u in range(5, 10)]
    views = RaytraceBackend().render_views(placed, array, at, samples=1)
    around = ((margin, margin), (margin + margin // 2, margin), (0, 0))
    return {(v - 5, u - 5): np.pad(view[..., :3], around) for (v, u), view in zip(at, views, strict=True)}


@pytest.mark.parametrize("name", NETWORKS)
def test_overlapping_boxes_are_the_same_to_the_bit(name, monkeypatch):
    """So it doesn't matter which of two threads writes last."""
    network, random = catalogue.load_light_field_network(name), np.random.default_rng(0)
    monkeypatch.setattr(network, "threads", 2)
    ends = [round(network.radius * part) for part in (0.6, 4.1, 4.7, 9.4, 10.6)]
    thing = np.zeros((ends[-1], ends[-1], 1), np.uint16)
    for part in (slice(*ends[:2]), slice(*ends[2:4])):  # less than two radii apart
        thing[part, part] = random.integers(0, 65536, (part.stop - part.start,) * 2 + (1,))
    boxes, covered = skipping.cover_with_boxes(thing[..., 0] > 0, network.radius), np.zeros(thing.shape, int)
    for box in boxes:
        covered[box.kept] += 1
    assert covered.max() == 2
    views = {(v, u): thing for v in range(3) for u in range(3)}
    (got, _), (want, _) = upscale_both_ways(network, views, [(0, 0), (2, 2)], (3, 3))
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("name", NETWORKS)
def test_rendered_views_are_the_same(name):
    network, fallback = catalogue.load_light_field_network(name), catalogue.load_upscaler("fast")
    wanted, statistics, views = [(2, 2), (0, 1)], SkipStatistics(), render_views(round(1.8 * network.radius))
    got, share = upscale_views(network, fallback, views, wanted, (5, 5), skip=True, statistics=statistics)
    want, expected_share = upscale_views(network, fallback, views, wanted, (5, 5), skip=False)
    np.testing.assert_array_equal(got, want)
    assert share == expected_share
    assert statistics.uniform > 0
