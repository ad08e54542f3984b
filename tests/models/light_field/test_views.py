"""Which views are used, and in which order results come."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import InvalidImage
from ciir.models.light_field.finishing import CONFIDENT, LARGEST_MISALIGNMENT, UNCERTAIN
from ciir.models.light_field.planes import Range
from ciir.models.light_field.views import upscale_views
from ciir.models.light_field.windows import WINDOW_SIDE, list_required_views, select_axis
from ciir.models.single.finishing import MOST
from ciir.models.single.interpolation import Bicubic
from ciir.models.single.pixels import upscale_pixels


class Repeating:
    """A stand-in for a network that repeats each view's pixels and records its inputs."""

    scale = 2
    radius = 2
    threads = runs = 1

    def __init__(self, uncertainty=0.3):
        self.calls, self.uncertainty = [], uncertainty

    def __call__(self, image, around, rows, cols, disparities, *, cores=None):
        self.calls.append((image, around, rows, cols, disparities))
        return image.repeat(2, axis=2).repeat(2, axis=3), np.full_like(image[:, :1], self.uncertainty)


class White:
    """A stand-in for a single-picture model."""

    name, scale, radius = "white", 2, 0

    def __call__(self, images):
        return np.ones_like(images).repeat(2, axis=2).repeat(2, axis=3)


fallback = White()


def make_light_field(grid, shape=(3, 4, 3), dtype=np.uint8):
    random = np.random.default_rng(0)
    most = np.iinfo(dtype).max
    return {(v, u): random.integers(0, most + 1, shape).astype(dtype) for v in range(grid[0]) for u in range(grid[1])}


def test_a_view_requires_its_window():
    assert list_required_views([(4, 4)], (9, 9)) == [(v, u) for v in range(2, 7) for u in range(2, 7)]
    assert list_required_views([(0, 7)], (9, 9)) == [(v, u) for v in range(5) for u in range(4, 9)]
    assert list_required_views([(1, 1)], (3, 3)) == [(v, u) for v in range(3) for u in range(3)]


grids = st.tuples(st.integers(1, 7), st.integers(1, 7))


@settings(max_examples=40)
@given(st.data(), grids, st.sampled_from([1, 3]), st.sampled_from([np.uint8, np.uint16]))
def test_results_come_in_the_order_of_wanted(data, grid, channels, dtype):
    views = make_light_field(grid, (3, 4, channels), dtype)
    wanted = data.draw(st.lists(st.sampled_from(sorted(views)), min_size=1, max_size=12))
    given = {view: views[view] for view in list_required_views(wanted, grid)}
    got, _ = upscale_views(Repeating(), fallback, given, wanted, grid)
    assert got.dtype == dtype
    for view, picture in zip(wanted, got, strict=True):
        np.testing.assert_array_equal(picture, views[view].repeat(2, axis=0).repeat(2, axis=1))


def test_the_network_gets_the_luma_of_the_window_row_by_row():
    views, network = make_light_field((6, 7)), Repeating()
    upscale_views(network, fallback, views, [(0, 3)], (6, 7))
    ((image, around, rows, cols, _),) = network.calls
    np.testing.assert_allclose(image[0], views[0, 3].transpose(2, 0, 1) / 255, atol=1e-7)
    np.testing.assert_array_equal(rows.present, [1, 0.5, 0.5, 0.5, 0.5])
    np.testing.assert_array_equal(cols.present, [0.5, 0.5, 1, 0.5, 0.5])
    for slot, (v, u) in enumerate((v, u) for v in select_axis(0, 6).views for u in select_axis(3, 7).views):
        wanted = views[v, u] @ np.array([0.299, 0.587, 0.114]) / 255
        np.testing.assert_allclose(around[0, slot], wanted, atol=1e-6)  # float32


def test_views_with_the_same_rows_and_columns_present_share_a_batch():
    network = Repeating()
    wanted = [(v, u) for v in range(7) for u in range(7)]
    upscale_views(network, fallback, make_light_field((7, 7)), wanted, (7, 7))
    assert len(network.calls) == WINDOW_SIDE * WINDOW_SIDE
    assert max(len(call[0]) for call in network.calls) == 9


def test_the_network_gets_the_range_that_is_measured_or_given(monkeypatch):
    ranges = {(0, 0): Range(-0.5, 0.25), (2, 2): Range(0.0, 1.0)}
    monkeypatch.setattr("ciir.models.light_field.runner.measure_ranges", lambda *_: (list(ranges.values()), [0.0] * 2))
    views, network = make_light_field((3, 3)), Repeating()
    upscale_views(network, fallback, views, list(ranges), (3, 3))
    assert [call[4] for call in network.calls] == list(ranges.values())
    upscale_views(network, fallback, views, list(ranges), (3, 3), disparities=Range(-0.7, 0.1))
    assert [call[4] for call in network.calls[2:]] == [(-0.7, 0.1)] * 2


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (np.zeros((3, 5, 3), np.uint8), r"view 0,1: \(3, 5, 3\) of uint8, but view 0,0 is \(3, 4, 3\)"),
        (np.zeros((3, 4, 3), np.uint16), "give views of one size and depth"),
    ],
)
def test_views_that_differ_in_shape_or_type_are_refused(other, message):
    views = make_light_field((3, 3)) | {(0, 1): other}
    with pytest.raises(InvalidImage, match=message):
        upscale_views(Repeating(), fallback, views, [(0, 0)], (3, 3))


def test_alpha_is_refused():
    with pytest.raises(InvalidImage, match=r"\(H, W, C\), grey or RGB"):
        upscale_views(Repeating(), fallback, make_light_field((3, 3), (3, 4, 4)), [(0, 0)], (3, 3))


def test_large_views_are_upscaled_in_tiles(monkeypatch):
    monkeypatch.setattr("ciir.models.light_field.runner.TILE_PIXELS", 100)
    views, network = make_light_field((3, 3), (23, 31, 3)), Repeating()
    (got,), _ = upscale_views(network, fallback, views, [(1, 1)], (3, 3))
    assert len(network.calls) > 10
    assert max(call[0].shape[2] * call[0].shape[3] for call in network.calls) <= 100
    np.testing.assert_array_equal(got, views[1, 1].repeat(2, axis=0).repeat(2, axis=1))


@pytest.mark.parametrize(
    ("uncertainty", "expected_share"), [(0.5, 0), (CONFIDENT + 0.25 * (UNCERTAIN - CONFIDENT), 0), (1.1, 1)]
)
def test_the_fallback_is_used_where_confidence_is_low(uncertainty, expected_share):
    views = make_light_field((3, 3))
    (got,), finished = upscale_views(Repeating(uncertainty), fallback, views, [(1, 1)], (3, 3))
    weight = np.clip((uncertainty - CONFIDENT) / (UNCERTAIN - CONFIDENT), 0, 1)
    own = views[1, 1].repeat(2, axis=0).repeat(2, axis=1)
    np.testing.assert_allclose(got, (1 - weight) * own + weight * 255, atol=0.51)
    assert [(finishing.fallback, finishing.sampling) for finishing in finished] == [(expected_share, None)]


def test_the_fallback_makes_all_of_a_misaligned_view(monkeypatch):
    views, wanted = make_light_field((3, 3)), [(0, 0), (1, 1)]
    given = [LARGEST_MISALIGNMENT, LARGEST_MISALIGNMENT + 0.01]
    monkeypatch.setattr("ciir.models.light_field.runner.measure_ranges", lambda *_: ([Range(-1.0, 1.0)] * 2, given))
    (kept, replaced), finished = upscale_views(Repeating(), fallback, views, wanted, (3, 3), finds_sampling=True)
    np.testing.assert_array_equal(kept, views[0, 0].repeat(2, axis=0).repeat(2, axis=1))
    bicubic = upscale_pixels(Bicubic(2), views[1, 1][np.newaxis])[0].astype(float)
    assert np.abs(replaced - (1 - MOST) * 255 - MOST * bicubic).max() <= 1.01  # white doesn't fit the view
    assert [(one.is_misaligned, one.fallback, one.misalignment) for one in finished] == [
        (False, 0.0, given[0]),
        (True, 1.0, given[1]),
    ]
    assert finished[1].sampling is None


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("uncertainty", "share"), [(0.5 * (CONFIDENT + UNCERTAIN), 0.5), (UNCERTAIN, 1.0)])
def test_a_fallback_that_does_not_fit_is_averaged_with_interpolation(dtype, uncertainty, share):
    """As one that makes white of everything, but not where views of a mesh are upscaled."""
    views = make_light_field((3, 3), (16, 12, 3), dtype)
    white = np.iinfo(dtype).max
    (got,), (finishing,) = upscale_views(Repeating(uncertainty), fallback, views, [(1, 1)], (3, 3), finds_sampling=True)
    bicubic = upscale_pixels(Bicubic(2), views[1, 1][np.newaxis])[0].astype(float)
    own = views[1, 1].repeat(2, axis=0).repeat(2, axis=1)
    wanted = (1 - share) * own + share * ((1 - MOST) * white + MOST * bicubic)
    assert np.abs(got - wanted).max() <= 1.01
    assert finishing.interpolated == pytest.approx(share * MOST)
    (got,), (finishing,) = upscale_views(Repeating(uncertainty), fallback, views, [(1, 1)], (3, 3))
    assert np.abs(got - (1 - share) * own - share * white).max() <= 1.01
    assert finishing.interpolated == 0


class Making:
    """A stand-in for both networks, which makes `level` of 8 bits of everything."""

    name, scale, radius, threads, runs = "making", 2, 0, 1, 1

    def __init__(self, level):
        self.level = level

    def __call__(self, images, *window, cores=None):
        made = np.full_like(images.repeat(2, axis=2).repeat(2, axis=3), self.level / 255)
        return (made, np.full_like(images[:, :1], (CONFIDENT + UNCERTAIN) / 2)) if window else made


def test_levels_are_rounded_once():
    views = make_light_field((3, 3))
    (got,), _ = upscale_views(Making(100.6), Making(101.6), views, [(1, 1)], (3, 3))
    assert got.dtype == np.uint8
    assert (got == 101).all()  # 101.1; the mean of 101 and 102 would be 102


@pytest.mark.parametrize(("rows", "is_used"), [(1, False), (3, True)])
def test_the_fallback_is_used_where_it_would_make_enough_of_a_view(rows, is_used):
    """Of ten rows, one is 10 % and three are 30 %, where 15 are needed; all others have a hundredth of its weight."""
    views = make_light_field((3, 3), (10, 8, 3))

    class UncertainRows(Repeating):
        def __call__(self, *given, **more):
            large, uncertainty = super().__call__(*given, **more)
            uncertainty[:, :, :rows] = UNCERTAIN
            uncertainty[:, :, rows:] = CONFIDENT + 0.01 * (UNCERTAIN - CONFIDENT)
            return large, uncertainty

    (got,), _ = upscale_views(UncertainRows(), fallback, views, [(1, 1)], (3, 3))
    assert bool((got[0] == 255).all()) == is_used


def test_skip_applies_to_the_fallback_too(monkeypatch):
    given = []

    def record(upscaler, pictures, *, skip, keeps_fractions):
        given.append((skip, keeps_fractions))
        return 257 * pictures.astype(np.uint16).repeat(2, axis=1).repeat(2, axis=2)

    monkeypatch.setattr("ciir.models.light_field.views.upscale_pixels", record)
    views = make_light_field((3, 3), (9, 8, 3))
    for skip in (True, False):
        upscale_views(Repeating(1.1), fallback, views, [(1, 1)], (3, 3), skip=skip)
    assert given == [(True, True), (False, True)]


class RepeatingOnThreeCores(Repeating):
    """Records how many cores each call gets."""

    threads = 3

    def __init__(self):
        super().__init__()
        self.cores = []

    def __call__(self, image, around, rows, cols, disparities, *, cores=None):
        self.cores.append(cores)
        return super().__call__(image, around, rows, cols, disparities, cores=cores)


def test_many_batches_run_in_parallel_and_few_get_all_cores():
    views, network = make_light_field((7, 7)), RepeatingOnThreeCores()
    got, _ = upscale_views(network, fallback, views, sorted(views), (7, 7))
    want, _ = upscale_views(Repeating(), fallback, views, sorted(views), (7, 7))
    np.testing.assert_array_equal(got, want)
    assert network.cores == [1] * WINDOW_SIDE * WINDOW_SIDE
    network.cores.clear()
    upscale_views(network, fallback, views, [(3, 3), (0, 0)], (7, 7))
    assert network.cores == [3, 3]


def test_an_error_in_one_of_many_batches_is_raised():
    class Broken(RepeatingOnThreeCores):
        def __call__(self, image, around, rows, cols, disparities, *, cores=None):
            if rows.present[0] == cols.present[0] == 1:
                raise InvalidImage("the corner")
            return super().__call__(image, around, rows, cols, disparities, cores=cores)

    views = make_light_field((7, 7))
    with pytest.raises(InvalidImage, match="the corner"):
        upscale_views(Broken(), fallback, views, sorted(views), (7, 7))


class UncertainWhereBright(Repeating):
    """Uncertain where the view's own luma is high, so that uncertainty varies with view and position."""

    def __call__(self, image, around, rows, cols, disparities, *, cores=None):
        large, uncertainty = super().__call__(image, around, rows, cols, disparities, cores=cores)
        own = rows.present.argmax() * WINDOW_SIDE + cols.present.argmax()
        return large, uncertainty * 0 + 1.2 * (around[:, own : own + 1] > 0.6)


@pytest.mark.parametrize("tile_pixels", [100, 65536])
def test_a_views_result_depends_on_no_other_view_and_on_no_tile(monkeypatch, tile_pixels):
    """Some views have low confidence in places, some nowhere, and one has content that moves by 5 pixels per view."""
    views = make_light_field((7, 7), (20, 24, 3))
    dark = {(v, u): views[v, u] // 2 for v in range(3) for u in range(7)}
    far = {(v, u): np.roll(views[5, 5], (5 * (v - 5), 5 * (u - 5)), (0, 1)) for v in range(4, 7) for u in range(4, 7)}
    views |= dark | far
    wanted = [(5, 5), (0, 0), (3, 3), (6, 0), (1, 5)]
    whole = [upscale_views(UncertainWhereBright(), fallback, views, [at], (7, 7)) for at in wanted]
    monkeypatch.setattr("ciir.models.light_field.runner.TILE_PIXELS", tile_pixels)
    batch, finished = upscale_views(UncertainWhereBright(), fallback, views, wanted, (7, 7))
    for got, how, (expected, expected_how) in zip(batch, finished, whole, strict=True):
        np.testing.assert_array_equal(got, expected[0])
        assert [how] == expected_how
    assert 0 < sum(how.fallback for how in finished) < len(wanted)


@pytest.mark.parametrize("view", [(2, 2), (0, 4), (3, 1)])
@pytest.mark.parametrize("shift", [-6, 0, 4])
def test_views_are_shifted_by_their_whole_disparity_first(shift, view):
    """The network then gets equal views, except near their edges; at the border up to 4 views away."""
    picture = np.random.default_rng(3).integers(0, 256, (104, 112, 3)).astype(np.uint8)
    views = {(v, u): np.roll(picture, (shift * (v - 2), shift * (u - 2)), (0, 1)) for v in range(5) for u in range(5)}
    network = Repeating()
    upscale_views(network, fallback, views, [view], (5, 5))
    around = next(around for _, around, *_ in network.calls if np.ptp(around[0, :, 52, 56]) == 0)
    inner = around[0][:, 30:-30, 30:-30]
    np.testing.assert_array_equal(inner, np.broadcast_to(inner[12], inner.shape))


class ShowingDifferences(Repeating):
    """Its picture is white where the neighbouring views differ, and black elsewhere."""

    radius = 4

    def __call__(self, image, around, rows, cols, disparities, *, cores=None):
        large, uncertainty = super().__call__(image, around, rows, cols, disparities, cores=cores)
        differs = np.ptp(around, axis=1, keepdims=True) > 0
        return large * 0 + differs.repeat(2, axis=2).repeat(2, axis=3), uncertainty


def test_each_part_of_a_view_has_its_own_shift():
    """The left half moves by 4 pixels per view, the right half by -6: all views agree but for edges."""
    halves = np.random.default_rng(3).integers(0, 256, (2, 96, 96, 3)).astype(np.uint8)
    views = {}
    for v in range(5):
        for u in range(5):
            left, right = (
                np.roll(half, (shift * (v - 2), shift * (u - 2)), (0, 1))
                for half, shift in zip(halves, (4, -6), strict=True)
            )
            views[v, u] = np.concatenate([left, right], axis=1)
    (got,), _ = upscale_views(ShowingDifferences(), fallback, views, [(2, 2)], (5, 5))
    assert not got[48:-48, 48 : 2 * 96 - 48].any()
    assert not got[48:-48, 2 * 96 + 48 : -48].any()
