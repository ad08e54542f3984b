"""Of light fields, too, what is skipped changes nothing."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.models import catalogue
from ciir.models.light_field import disparity
from ciir.models.light_field.views import upscale_views
from ciir.models.single import skipping
from ciir.models.single.skipping import SkipStatistics
from ciir.renderer.backends.embree import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene
from tests.models.mixing import Mixing, MixingViews

FIELDS = [entry.name for entry in catalogue.list_entries() if entry.is_light_field and not entry.unsupported_reason]


def field(grid, shape, *, moves=1, seed=0, dtype=np.uint8, size=4, at=(6, 6)):
    """A square of noise at `at` in the middle view, before one colour, that moves by `moves` pixels a view."""
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


def both(network, views, wanted, grid, statistics=None):
    alone = Mixing()
    skipped = upscale_views(network, alone, views, wanted, grid, statistics=statistics)
    whole = upscale_views(network, alone, views, wanted, grid, skip=False)
    return skipped, whole


@settings(derandomize=True, deadline=None, max_examples=60)
@given(
    st.data(),
    st.tuples(st.integers(1, 6), st.integers(1, 6)),
    st.tuples(st.integers(1, 30), st.integers(1, 30), st.sampled_from([1, 3])),
    st.tuples(st.integers(-2, 25), st.integers(-2, 25)),
    st.integers(-4, 4),
)
def test_it_equals_the_whole(data, grid, shape, at, moves):
    dtype = data.draw(st.sampled_from([np.uint8, np.uint16]))
    views = field(grid, shape, moves=moves, at=at, dtype=dtype, seed=data.draw(st.integers(0, 9)))
    if data.draw(st.booleans()):  # another colour around some view
        views[data.draw(st.sampled_from(sorted(views)))][...] = 3
    wanted = data.draw(st.lists(st.sampled_from(sorted(views)), min_size=1, max_size=8))
    statistics = SkipStatistics()
    (got, left), (want, wished) = both(MixingViews(), views, wanted, grid, statistics)
    np.testing.assert_array_equal(got, want)
    assert left == pytest.approx(wished)
    assert statistics.pixels == len(wanted) * shape[0] * shape[1]
    assert statistics.uniform + statistics.repeated <= statistics.pixels


def test_a_radius_that_is_said_too_small_shows():
    views = field((5, 5), (40, 40, 3), at=(18, 18))
    (got, _), (want, _) = both(MixingViews(4), views, [(2, 2)], (5, 5))
    np.testing.assert_array_equal(got, want)
    (got, _), (want, _) = both(MixingViews(4, radius=3), views, [(2, 2)], (5, 5))
    assert not np.array_equal(got, want)


@pytest.mark.parametrize("window", [20 * 20, 65536])
@pytest.mark.parametrize("moves", [1, 5])
def test_what_a_view_becomes_depends_on_no_other_view_and_on_no_tile(monkeypatch, moves, window):
    views = field((7, 7), (60, 64, 3), moves=moves, at=(28, 28), size=12)
    wanted = [(3, 3), (0, 0), (6, 2), (3, 4)]
    assert disparity.of(views, (3, 3), (7, 7)) == (moves if moves > 1 else 0)
    whole = [upscale_views(MixingViews(), Mixing(), views, [at], (7, 7), skip=False)[0][0] for at in wanted]
    monkeypatch.setattr("ciir.models.light_field.views.WINDOW", window)
    statistics = SkipStatistics()
    got, _ = upscale_views(MixingViews(), Mixing(), views, wanted, (7, 7), statistics=statistics)
    np.testing.assert_array_equal(got, whole)
    assert statistics.uniform > 0


def test_the_box_holds_what_differs_in_any_view_of_the_window():
    views, network, statistics = field((5, 5), (50, 60, 3), at=(20, 22)), MixingViews(doubtful=False), SkipStatistics()
    upscale_views(network, Mixing(), views, [(2, 2)], (5, 5), statistics=statistics)
    seen = network.seen
    upscale_views(network, Mixing(), views, [(2, 2)], (5, 5))
    box = 4 + 2 * 2 + 4 * 3  # the square, two pixels of movement to each side, twice the radius
    assert network.seen - seen == box * box
    assert statistics.uniform == 50 * 60 - box * box


def test_windows_that_repeat_are_made_once():
    """Of a scene without parallax, the views whose windows are whole."""
    views, network, statistics = (
        field((7, 7), (12, 12, 3), moves=0, size=12, at=(0, 0)),
        MixingViews(),
        SkipStatistics(),
    )
    wanted = [(v, u) for v in range(7) for u in range(7)]
    (got, _), (want, _) = both(network, views, wanted, (7, 7), statistics)
    np.testing.assert_array_equal(got, want)
    assert statistics.repeated == (49 - 25) * 144
    assert statistics.pixels == 49 * 144


def test_nothing_is_skipped_where_that_is_asked_for():
    views, network, statistics = field((3, 3), (30, 30, 3), moves=0), MixingViews(doubtful=False), SkipStatistics()
    upscale_views(network, Mixing(), views, [(1, 1), (1, 1)], (3, 3), skip=False, statistics=statistics)
    assert network.seen == statistics.pixels == 2 * 900
    assert statistics.uniform == statistics.repeated == 0


@cache
def rendered():
    """Views of the vase, 5x5 of 48x48 pixels with a wide margin."""
    array = LensArray(48, 48, 15, 15)
    placed = load_scene("vase").transform(frame_scene(load_scene("vase"), array))
    at = [(v, u) for v in range(5, 10) for u in range(5, 10)]
    views = RaytraceBackend().render_views(placed, array, at, samples=1)
    margin = ((30, 30), (44, 30), (0, 0))
    return {(v - 5, u - 5): np.pad(view[..., :3], margin) for (v, u), view in zip(at, views, strict=True)}


@pytest.mark.parametrize("name", FIELDS)
def test_where_boxes_overlap_both_are_the_same_to_the_bit(name, monkeypatch):
    """Whichever of two threads writes last."""
    network, random = catalogue.load_light_field_network(name), np.random.default_rng(0)
    monkeypatch.setattr(network, "threads", 2)
    thing = np.zeros((180, 180, 1), np.uint16)
    for part in (slice(10, 70), slice(80, 160)):
        thing[part, part] = random.integers(0, 65536, (part.stop - part.start,) * 2 + (1,))
    found, covered = skipping.boxes(thing[..., 0] > 0, network.radius), np.zeros(thing.shape, int)
    for box in found:
        covered[box.kept] += 1
    assert covered.max() == 2
    views = {(v, u): thing for v in range(3) for u in range(3)}
    (got, _), (want, _) = both(network, views, [(0, 0), (2, 2)], (3, 3))
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("name", FIELDS)
def test_rendered_views_equal_the_whole(name):
    network, alone = catalogue.load_light_field_network(name), catalogue.load_upscaler("fast")
    wanted, statistics = [(2, 2), (0, 1)], SkipStatistics()
    got, left = upscale_views(network, alone, rendered(), wanted, (5, 5), skip=True, statistics=statistics)
    want, wished = upscale_views(network, alone, rendered(), wanted, (5, 5), skip=False)
    np.testing.assert_array_equal(got, want)
    assert left == wished
    assert statistics.uniform > 0
