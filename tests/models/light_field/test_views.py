"""Which views are looked at, and that each comes out where it was asked for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import InvalidImage
from ciir.models.light_field.views import CONFIDENT, UNCERTAIN, list_required_views, upscale_views
from ciir.models.light_field.windows import WINDOW_SIDE, select_axis


class Told:
    """A stand-in for a network: repeats each view's pixels and notes what it was called with."""

    scale = 2
    radius = 2
    threads = 1

    def __init__(self, doubt=0.3):
        self.calls, self.doubt = [], doubt

    def __call__(self, image, around, rows, cols, *, cores=None):
        self.calls.append((image, around, rows, cols))
        return image.repeat(2, axis=2).repeat(2, axis=3), np.full_like(image[:, :1], self.doubt)


class White:
    """A stand-in for a model of single pictures."""

    name, scale, radius = "white", 2, 0

    def __call__(self, images):
        return np.ones_like(images).repeat(2, axis=2).repeat(2, axis=3)


alone = White()


def field(grid, shape=(3, 4, 3), dtype=np.uint8):
    random = np.random.default_rng(0)
    most = np.iinfo(dtype).max
    return {(v, u): random.integers(0, most + 1, shape).astype(dtype) for v in range(grid[0]) for u in range(grid[1])}


def test_a_view_needs_its_window_and_no_more():
    assert list_required_views([(4, 4)], (9, 9)) == [(v, u) for v in range(2, 7) for u in range(2, 7)]
    assert list_required_views([(0, 8)], (9, 9)) == [(v, u) for v in range(3) for u in range(6, 9)]
    assert list_required_views([(1, 1)], (3, 3)) == [(v, u) for v in range(3) for u in range(3)]


grids = st.tuples(st.integers(1, 7), st.integers(1, 7))


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.data(), grids, st.sampled_from([1, 3]), st.sampled_from([np.uint8, np.uint16]))
def test_each_view_comes_out_in_its_place(data, grid, channels, dtype):
    views = field(grid, (3, 4, channels), dtype)
    wanted = data.draw(st.lists(st.sampled_from(sorted(views)), min_size=1, max_size=12))
    got, _ = upscale_views(
        Told(), alone, {view: views[view] for view in list_required_views(wanted, grid)}, wanted, grid
    )
    assert got.dtype == dtype
    for view, picture in zip(wanted, got, strict=True):
        np.testing.assert_array_equal(picture, views[view].repeat(2, axis=0).repeat(2, axis=1))


def test_the_network_is_given_the_luma_of_the_window_row_by_row():
    views, network = field((6, 7)), Told()
    upscale_views(network, alone, views, [(0, 3)], (6, 7))
    ((image, around, rows, cols),) = network.calls
    np.testing.assert_allclose(image[0], views[0, 3].transpose(2, 0, 1) / 255, atol=1e-7)
    np.testing.assert_array_equal(rows, [0, 0, 1, 1, 1])
    np.testing.assert_array_equal(cols, [1, 1, 1, 1, 1])
    for slot, (v, u) in enumerate((v, u) for v in select_axis(0, 6).views for u in select_axis(3, 7).views):
        wanted = views[v, u] @ np.array([0.299, 0.587, 0.114]) / 255
        np.testing.assert_allclose(around[0, slot], wanted, atol=1e-6)  # float32


def test_views_whose_windows_stand_alike_go_together():
    network = Told()
    wanted = [(v, u) for v in range(7) for u in range(7)]
    upscale_views(network, alone, field((7, 7)), wanted, (7, 7))
    assert len(network.calls) == WINDOW_SIDE * WINDOW_SIDE
    assert max(len(call[0]) for call in network.calls) == 9


@pytest.mark.parametrize(
    ("odd", "words"),
    [
        (np.zeros((3, 5, 3), np.uint8), r"view 0,1: \(3, 5, 3\) of uint8, where view 0,0 is \(3, 4, 3\)"),
        (np.zeros((3, 4, 3), np.uint16), "give views of one size and depth"),
    ],
)
def test_views_that_differ_are_named(odd, words):
    views = field((3, 3)) | {(0, 1): odd}
    with pytest.raises(InvalidImage, match=words):
        upscale_views(Told(), alone, views, [(0, 0)], (3, 3))


def test_alpha_is_refused():
    with pytest.raises(InvalidImage, match=r"\(H, W, C\), grey or RGB"):
        upscale_views(Told(), alone, field((3, 3), (3, 4, 4)), [(0, 0)], (3, 3))


def test_large_views_go_in_tiles_and_come_out_whole(monkeypatch):
    monkeypatch.setattr("ciir.models.light_field.views.WINDOW", 100)
    views, network = field((3, 3), (23, 31, 3)), Told()
    (got,), _ = upscale_views(network, alone, views, [(1, 1)], (3, 3))
    assert len(network.calls) > 10
    assert max(call[0].shape[2] * call[0].shape[3] for call in network.calls) <= 100
    np.testing.assert_array_equal(got, views[1, 1].repeat(2, axis=0).repeat(2, axis=1))


@pytest.mark.parametrize(("doubt", "share"), [(0.5, 0), (CONFIDENT + 0.25 * (UNCERTAIN - CONFIDENT), 0), (0.9, 1)])
def test_where_the_views_do_not_match_another_model_takes_over(doubt, share):
    views = field((3, 3))
    (got,), left = upscale_views(Told(doubt), alone, views, [(1, 1)], (3, 3))
    part = np.clip((doubt - CONFIDENT) / (UNCERTAIN - CONFIDENT), 0, 1)
    own = views[1, 1].repeat(2, axis=0).repeat(2, axis=1)
    np.testing.assert_allclose(got, (1 - part) * own + part * 255, atol=1.01)  # rounded twice
    assert left == share


def test_what_takes_a_strange_views_place_is_skipped_like_the_rest(monkeypatch):
    asked = []

    def noted(upscaler, pictures, *, skip):
        asked.append(skip)
        return pictures.repeat(2, axis=1).repeat(2, axis=2)

    monkeypatch.setattr("ciir.models.light_field.views.upscale_pixels", noted)
    views = field((3, 3), (9, 8, 3))
    for skipping in (True, False):
        upscale_views(Told(0.9), alone, views, [(1, 1)], (3, 3), skip=skipping)
    assert asked == [True, False]


class Abreast(Told):
    """On a machine of three cores; notes how many each call may take."""

    threads = 3

    def __init__(self):
        super().__init__()
        self.cores = []

    def __call__(self, image, around, rows, cols, *, cores=None):
        self.cores.append(cores)
        return super().__call__(image, around, rows, cols, cores=cores)


def test_many_runs_go_side_by_side_and_few_take_all_cores():
    views, network = field((7, 7)), Abreast()
    got, _ = upscale_views(network, alone, views, sorted(views), (7, 7))
    want, _ = upscale_views(Told(), alone, views, sorted(views), (7, 7))
    np.testing.assert_array_equal(got, want)
    assert network.cores == [1] * WINDOW_SIDE * WINDOW_SIDE
    network.cores.clear()
    upscale_views(network, alone, views, [(3, 3), (0, 0)], (7, 7))
    assert network.cores == [3, 3]


def test_an_error_of_one_run_among_many_is_raised():
    class Broken(Abreast):
        def __call__(self, image, around, rows, cols, *, cores=None):
            if not rows[0] and not cols[0]:
                raise InvalidImage("the corner")
            return super().__call__(image, around, rows, cols, cores=cores)

    views = field((7, 7))
    with pytest.raises(InvalidImage, match="the corner"):
        upscale_views(Broken(), alone, views, sorted(views), (7, 7))


class Unsure(Told):
    """In doubt where a view's own luma is high; so each view and place has a doubt of its own."""

    def __call__(self, image, around, rows, cols, *, cores=None):
        large, doubt = super().__call__(image, around, rows, cols, cores=cores)
        return large, doubt * 0 + (around[:, 12:13] > 0.6)


@pytest.mark.parametrize("window", [100, 65536])
def test_what_a_view_becomes_depends_on_no_other_view_and_on_no_tile(monkeypatch, window):
    """Some views are in doubt here and there, some nowhere, and one has content that moves by 5 pixels a view."""
    views = field((7, 7), (20, 24, 3))
    dark = {(v, u): views[v, u] // 2 for v in range(3) for u in range(7)}
    far = {(v, u): np.roll(views[5, 5], (5 * (v - 5), 5 * (u - 5)), (0, 1)) for v in range(4, 7) for u in range(4, 7)}
    views |= dark | far
    wanted = [(5, 5), (0, 0), (3, 3), (6, 0), (1, 5)]
    whole = [upscale_views(Unsure(), alone, views, [at], (7, 7)) for at in wanted]
    monkeypatch.setattr("ciir.models.light_field.views.WINDOW", window)
    together, left = upscale_views(Unsure(), alone, views, wanted, (7, 7))
    for got, (wished, _) in zip(together, whole, strict=True):
        np.testing.assert_array_equal(got, wished[0])
    assert left == pytest.approx(np.mean([share for _, share in whole]))
    assert 0 < left < 1


@pytest.mark.parametrize("by", [-5, 0, 3])
def test_whole_disparities_are_taken_away_first(by):
    """The network then sees the same in all views, but for what lies beyond their edges."""
    picture = np.random.default_rng(3).integers(0, 256, (60, 50, 3)).astype(np.uint8)
    views = {(v, u): np.roll(picture, (by * (v - 2), by * (u - 2)), (0, 1)) for v in range(5) for u in range(5)}
    network = Told()
    upscale_views(network, alone, views, [(2, 2)], (5, 5))
    ((_, around, _, _),) = network.calls
    inner = around[0][:, 12:-12, 12:-12]
    np.testing.assert_array_equal(inner, np.broadcast_to(inner[12], inner.shape))
