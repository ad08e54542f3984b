from functools import partial

import numpy as np
import pytest
from scipy import ndimage

from ciir.models.light_field.finishing import Finishing
from ciir.models.light_field.fusion import views as fusion_views
from ciir.models.light_field.fusion.disparity import FINE_STEP, STEP
from ciir.models.light_field.fusion.views import (
    MOST_PIXELS,
    FusingUpscaler,
    explain_no_fusion,
    list_block,
    list_cross,
    list_fused_views,
)
from ciir.models.light_field.planes import Range
from ciir.models.light_field.strides import list_spaced_views
from ciir.models.sampling import Sampling

GRID = (6, 5)


class Upscaling:
    """A stand-in for `upscale_views`: repeats pixels, adds noise of the view's own, and counts the views."""

    def __init__(self, finishing=None, noise=3):
        self.made = []
        self.finishing, self.noise = finishing or Finishing(), noise

    def __call__(self, views, wanted, grid):
        self.made += wanted
        large = []
        for view in wanted:
            picture = views[view].repeat(2, axis=0).repeat(2, axis=1)
            noise = np.random.default_rng(view).integers(-self.noise, self.noise + 1, (*picture.shape[:2], 1))
            large.append((picture.astype(int) + noise).clip(0, np.iinfo(picture.dtype).max).astype(picture.dtype))
        return np.stack(large), [self.finishing._replace(disparities=Range(-0.5, 0.5)) for _ in wanted]


def make_views(grid=GRID, dtype=np.uint8, channels=3, level=200):
    picture = np.random.default_rng(0).integers(20, level, (16, 18, channels)).astype(dtype)
    return {(v, u): picture for v in range(grid[0]) for u in range(grid[1])}


def make_upscaler(upscale, views, grid=GRID, stride=1, *, fusion="always", matches=False, is_jpeg=False, cores=1):
    return FusingUpscaler(
        upscale,
        grid,
        stride,
        fusion=fusion,
        matches=matches,
        is_jpeg=is_jpeg,
        fetch=lambda some: {view: views[view] for view in some},
        cores=cores,
    )


@pytest.mark.parametrize(
    ("view", "grid", "rows", "cols"),
    [
        ((2, 3), (6, 7), (1, 2, 3), (2, 3, 4)),
        ((0, 0), (6, 7), (0, 1, 2), (0, 1, 2)),
        ((5, 3), (6, 7), (3, 4, 5), (2, 3, 4)),
        ((0, 0), (2, 1), (0, 1), (0,)),
    ],
)
def test_a_block_is_moved_inwards_at_the_border(view, grid, rows, cols):
    assert list_block(view, grid) == [(v, u) for v in rows for u in cols]


def test_the_disparity_is_measured_with_five_views_of_each_line():
    assert list_cross((0, 3), (6, 7)) == [(0, 1), (0, 2), (0, 3), (0, 4), (0, 5), (1, 3), (2, 3), (3, 3), (4, 3)]
    assert list_cross((1, 1), (2, 3)) == [(0, 1), (1, 0), (1, 1), (1, 2)]


@pytest.mark.parametrize(("cores", "matches"), [(1, False), (2, False), (2, True)])
def test_each_view_is_upscaled_once_and_no_result_depends_on_the_others(cores, matches):
    finishing = Finishing(sampling=Sampling("means", likeness=1.0, gain=1.0, noise=0.0))
    views, upscale = make_views(), Upscaling(finishing)
    fusing = make_upscaler(upscale, views, cores=cores, matches=matches)
    every = list(views)
    made = {}
    for first in range(0, len(every), 4):
        wanted = every[first : first + 4]
        given = {view: views[view] for view in list_spaced_views(wanted, GRID, 1)}
        pictures, finished = fusing(given, wanted)
        assert all(finishing.is_fused for finishing in finished)
        made.update(zip(wanted, pictures, strict=True))
    assert sorted(upscale.made) == every
    for view in ((0, 0), (3, 2), (5, 4), (1, 0)):
        alone = Upscaling(finishing)
        (picture,), (finished,) = make_upscaler(alone, views, matches=matches)({}, [view])
        assert finished.is_matched == matches
        assert np.array_equal(picture, made[view])
        assert sorted(alone.made) == list_block(view, GRID)


@pytest.mark.parametrize(
    "order", [lambda v, u: (v, u), lambda v, u: (-v, u), lambda v, u: (u, v), lambda v, u: (u, -v)]
)
def test_rows_and_columns_in_either_direction_are_upscaled_once(order):
    views, upscale = make_views((7, 7)), Upscaling()
    fusing = make_upscaler(upscale, views, (7, 7))
    for view in sorted(views, key=lambda view: order(*view)):
        fusing({}, [view])
    assert len(upscale.made) == 49


@pytest.mark.parametrize(("at_once", "matches", "stride"), [(1, False, 1), (4, False, 1), (1, True, 1), (1, True, 2)])
def test_views_in_no_order(at_once, matches, stride):
    """Means of rows and disparities are kept for longer than the views that they are of."""
    grid = (15, 15)
    views = make_views(grid)
    order = [*views]
    np.random.default_rng(0).shuffle(order)
    finishing = Finishing(sampling=Sampling("means", likeness=1.0, gain=1.0, noise=0.0))
    fusing = make_upscaler(Upscaling(finishing), views, grid, stride, matches=matches)
    for first in range(0, 60, at_once):
        wanted = [tuple(view) for view in order[first : first + at_once]]
        made, _ = fusing({}, wanted)
        assert len(made) == at_once
    (alone,), _ = make_upscaler(Upscaling(finishing), views, grid, stride, matches=matches)({}, wanted[-1:])
    assert np.array_equal(made[-1], alone)


def test_windows_of_every_second_view():
    views = make_views((11, 10))
    every, _ = make_upscaler(Upscaling(), views, (11, 10), 2)(views, list(views))
    for view in ((0, 0), (5, 6), (10, 9)):
        upscale = Upscaling()
        (alone,), (finishing,) = make_upscaler(upscale, views, (11, 10), 2)({}, [view])
        assert np.array_equal(alone, every[list(views).index(view)])
        assert finishing.is_fused


def test_disparities_are_those_of_windows(monkeypatch):
    seen, steps = [], set()
    estimate = fusion_views.estimate_disparity

    def record(own, beside, limits, *, step):
        seen.append(limits)
        steps.add(step)
        return estimate(own, beside, limits, step=step)

    monkeypatch.setattr(fusion_views, "estimate_disparity", record)
    for stride in (1, 2):
        make_upscaler(Upscaling(), make_views((11, 10)), (11, 10), stride)({}, [(5, 5)])
    assert seen == [Range(-0.5, 0.5)] * 3 + [Range(-0.25, 0.25)] * 3  # of the three rows of a block
    assert steps == {STEP}
    steps.clear()
    make_upscaler(Upscaling(), make_views(), matches=True)({}, [(2, 2)])
    assert steps == {FINE_STEP}


def test_little_contrast_is_treated_like_much():
    views = make_views()
    faint = {view: (100 + (picture.astype(int) - 100) // 10).astype(np.uint8) for view, picture in views.items()}
    others = {
        view: faint[view] if view == (2, 2) else np.roll(faint[view], 5 * sum(view), axis=(0, 1)) for view in faint
    }
    (single,), _ = Upscaling(noise=0)(others, [(2, 2)], GRID)
    (fused,), _ = make_upscaler(Upscaling(noise=0), others)({}, [(2, 2)])  # with views that show other things
    assert np.abs(fused.astype(int) - single).max() <= 1


def test_a_dark_view_of_many_bits_among_bright_ones_does_not_overflow():
    views = {view: 16 * picture for view, picture in make_views(dtype=np.uint16, level=1000).items()}
    views[2, 2] = views[2, 2] // 20
    finishing = Finishing(sampling=Sampling("means", 1.0, 1.0, 0.0))

    class Brighter(Upscaling):
        def __call__(self, views, wanted, grid):
            made, finished = super().__call__(views, wanted, grid)
            return made + np.uint16(300), finished

    (picture,), _ = make_upscaler(Brighter(finishing), views)({}, [(2, 2)])
    own = views[2, 2].repeat(2, axis=0).repeat(2, axis=1).astype(int)
    assert np.abs(picture - own).max() < 400


def test_views_of_one_colour_stay():
    views = {view: np.full((16, 18, 3), 77, np.uint8) for view in make_views()}
    (fused,), (finishing,) = make_upscaler(Upscaling(noise=0), views)({}, [(2, 2)])
    assert np.all(fused == 77)
    assert finishing.is_fused


def test_views_may_be_wanted_in_any_order():
    views = make_views()
    made, _ = make_upscaler(Upscaling(), views)({}, [(4, 4), (0, 1)])
    fusing = make_upscaler(Upscaling(), views)
    for number, view in enumerate([(4, 4), (0, 1)]):
        assert np.array_equal(fusing({}, [view])[0][0], made[number])


@pytest.mark.parametrize(("fusion", "side"), [("auto", 30), ("always", 12)])
def test_little_is_kept(fusion, side):
    views = make_views((side, side))
    fusing = make_upscaler(Upscaling(), views, (side, side), fusion=fusion)
    for row in range(side):
        fusing(views, [(row, u) for u in range(side)])
        assert max(len(fusing._upscaled), len(fusing._rows)) <= 4 * side
        assert len(fusing._views) <= 8 * side


def test_the_mean_has_less_noise():
    views = make_views()
    own = views[0, 0].repeat(2, axis=0).repeat(2, axis=1).astype(int)
    (single,), _ = Upscaling()(views, [(2, 2)], GRID)
    (fused,), _ = make_upscaler(Upscaling(), views)({}, [(2, 2)])
    assert np.std(fused.astype(int) - own) < 0.75 * np.std(single.astype(int) - own)


class Moving(Upscaling):
    """Upscales views whose content moves by a pixel from one to the next: the truth, and noise of the view's own."""

    def __init__(self, way):
        super().__init__()
        texture = np.random.default_rng(5).integers(0, 2, (40, 48, 3)) * 150 + 50
        large = {(v, u): np.roll(texture, (2 * way * v, 2 * way * u), axis=(0, 1)) for v in range(6) for u in range(5)}
        self.large = {view: ndimage.uniform_filter(moved, (4, 4, 0), mode="wrap") for view, moved in large.items()}
        self.views = {
            view: moved.reshape(20, 2, 24, 2, 3).mean(axis=(1, 3)).astype(np.uint8)
            for view, moved in self.large.items()
        }

    def __call__(self, views, wanted, grid):
        large = [self.large[view] + np.random.default_rng(view).integers(-4, 5, (40, 48, 1)) for view in wanted]
        return np.stack(large).astype(np.uint8), [Finishing(disparities=Range(-1.5, 1.5)) for _ in wanted]


@pytest.mark.parametrize("way", [-1, 1])
def test_content_that_moves_is_followed(way):
    upscale = Moving(way)
    (fused,), _ = make_upscaler(upscale, upscale.views)({}, [(2, 2)])
    (single,), _ = upscale(upscale.views, [(2, 2)], GRID)
    error, before = (np.std((picture - upscale.large[2, 2].astype(int))[8:-8, 8:-8]) for picture in (fused, single))
    assert error < 0.6 * before


def test_levels_beyond_the_range_are_not_wrapped():
    picture = np.random.default_rng(0).choice(np.array([0, 255], np.uint8), (16, 18, 1)).repeat(3, axis=2)
    views = dict.fromkeys(make_views(), picture)
    (single,), _ = Upscaling()(views, [(2, 2)], GRID)
    (fused,), _ = make_upscaler(Upscaling(), views)({}, [(2, 2)])
    assert np.abs(fused.astype(int) - single).max() < 100


def test_a_view_whose_sampling_is_guessed_from_its_block_is_not_matched():
    means = Finishing(sampling=Sampling("means", 1.0, 1.0, 0.0))

    class Partly(Upscaling):
        def __call__(self, views, wanted, grid):
            made, finished = super().__call__(views, wanted, grid)
            return made, [Finishing() if view == (2, 2) else means for view, _ in zip(wanted, finished, strict=True)]

    views = make_views()
    wanted = [(2, 2), (2, 3)]
    _, finished = make_upscaler(Partly(means), views, matches=True)(views, wanted)
    assert [each.is_matched for each in finished] == [False, True]
    assert finished[0].sampling == means.sampling


@pytest.mark.parametrize(
    ("sampling", "expected"),
    [
        (Sampling("filter", likeness=1.0, gain=0.5, noise=0.0), True),
        (Sampling("filter", likeness=0.9, gain=0.9, noise=0.0), False),
        (Sampling("means", likeness=1.0, gain=0.0, noise=0.0), False),
        (None, False),
    ],
)
def test_views_are_matched_only_if_it_is_certain_how_they_were_sampled(sampling, expected):
    views = make_views()
    _, (got,) = make_upscaler(Upscaling(Finishing(sampling=sampling)), views, matches=True)(views, [(2, 2)])
    assert (got.is_fused, got.is_matched) == (True, expected)


def test_the_rule_of_auto():
    views = make_views()
    for finishing, is_jpeg, is_fused in (
        (Finishing(), False, False),
        (Finishing(sampling=Sampling("means", 1.0, 1.0, 0.0)), False, False),
        (Finishing(sampling=Sampling("filter", 1.0, 0.0, 0.0)), False, True),
        (Finishing(), True, True),
        (Finishing(misalignment=0.5), True, False),
    ):
        always = not finishing.is_misaligned
        for fusion, expected in (("auto", is_fused), ("always", always), ("never", False)):
            upscale = Upscaling(finishing)
            fusing = make_upscaler(upscale, views, fusion=fusion, is_jpeg=is_jpeg)
            (picture,), (got,) = fusing(views, [(2, 2)])
            assert got.is_fused == expected
            assert len(upscale.made) == (9 if expected else 1)
            plain = Upscaling(finishing)(views, [(2, 2)], GRID)[0][0]
            assert np.array_equal(picture, plain) != expected


def test_what_keeps_auto_from_fusing():
    assert explain_no_fusion(MOST_PIXELS, 1) == ""
    assert "pixels take long" in explain_no_fusion(MOST_PIXELS + 1, 1)
    assert "moves little" in explain_no_fusion(100, 2)


def test_grey_stays_grey_and_the_camera_has_few_bits():
    for dtype, level in ((np.uint8, 200), (np.uint16, 1000)):  # a camera of 10 bits, whose levels look nearly black
        views = make_views(dtype=dtype, channels=1, level=level)
        coloured = {view: picture.repeat(3, axis=2) for view, picture in views.items()}
        noise = 3 * level // 200
        (grey,), _ = make_upscaler(Upscaling(noise=noise), views)({}, [(2, 2)])
        (fused,), _ = make_upscaler(Upscaling(noise=noise), coloured)({}, [(2, 2)])
        assert np.ptp(fused.astype(int), axis=2).max() == 0
        np.testing.assert_allclose(fused[..., :1].astype(int), grey.astype(int), atol=1)  # sums in another order
        (single,), _ = Upscaling(noise=noise)(views, [(2, 2)], GRID)
        own = views[0, 0].repeat(2, axis=0).repeat(2, axis=1).astype(int)
        ratio = np.std(grey.astype(int) - own) / np.std(single.astype(int) - own)
        assert 0.3 < ratio < 0.75  # as with 8 bits: were 10 bits taken for 16, nothing would seem to differ


def test_restored_views_are_closer_to_what_was_seen_than_fused_ones():
    views = make_views()
    sampling = Sampling("means", 1.0, 1.0, 0.0)

    def measure(finishing, *, is_jpeg=False):
        fusing = make_upscaler(Upscaling(finishing, noise=12), views, is_jpeg=is_jpeg)
        (picture,), _ = fusing({}, [(2, 2)])
        means = picture.reshape(16, 2, 18, 2, 3).mean(axis=(1, 3))
        return np.abs(means.mean(axis=2) - views[2, 2].mean(axis=2)).mean()

    assert measure(Finishing(sampling=sampling)) < 0.5 * measure(Finishing())
    few_bits = make_views(dtype=np.uint16, level=1000)
    fusing = make_upscaler(Upscaling(Finishing(sampling=sampling), noise=60), few_bits)
    (picture,), _ = fusing({}, [(2, 2)])
    means = picture.reshape(16, 2, 18, 2, 3).mean(axis=(1, 3))
    assert np.abs(means.mean(axis=2) - few_bits[2, 2].mean(axis=2)).mean() < 2
    noisy = sampling._replace(noise=1 / 255)
    assert measure(Finishing(sampling=noisy)) < measure(Finishing(sampling=noisy), is_jpeg=True)


@pytest.mark.parametrize(("dtype", "level"), [(np.uint8, 30), (np.uint16, 500)])
def test_dark_views_are_restored_like_bright_ones(dtype, level):
    """Noise of 0.05 was found in the raised view; in the dark one it would hide every difference."""
    views = make_views(dtype=dtype, level=level)

    def measure(sampling):
        (picture,), _ = make_upscaler(Upscaling(Finishing(sampling=sampling), noise=level // 4), views)({}, [(2, 2)])
        means = picture.reshape(16, 2, 18, 2, 3).mean(axis=(1, 3))
        return np.abs(means.mean(axis=2) - views[2, 2].mean(axis=2)).mean()

    assert measure(Sampling("means", 1.0, 1.0, 0.05)) < 0.7 * measure(None)


def test_a_view_that_leaves_its_sampling_open_follows_its_block():
    views, means = make_views(), Sampling("means", 1.0, 1.0, 0.0)
    filtered = Sampling("filter", 1.0, 1.0, 0.0)

    class Unsure(Upscaling):
        def __init__(self, others):
            super().__init__(noise=12)
            self.others = others

        def __call__(self, views, wanted, grid):
            made, finished = super().__call__(views, wanted, grid)
            return made, [
                each._replace(sampling=self.others.get(view)) for view, each in zip(wanted, finished, strict=True)
            ]

    block = [view for view in list_block((2, 2), GRID) if view != (2, 2)]
    for others, sampling in (
        (dict.fromkeys(block[:5], means), means),
        (dict.fromkeys(block[:4], means), None),
        (dict.fromkeys(block, filtered), None),  # it would have become a mean with the fallback before
        (dict.fromkeys(block, means) | {(2, 2): filtered}, filtered),
    ):
        (picture,), (finishing,) = make_upscaler(Unsure(others), views)({}, [(2, 2)])
        assert finishing.sampling == sampling
        seen = picture.reshape(16, 2, 18, 2, 3).mean(axis=(1, 3, 4))
        is_close = np.abs(seen - views[2, 2].mean(axis=2)).mean() < 1
        assert is_close == (sampling is means)


def test_fused_views_need_the_windows_of_their_blocks():
    needed = list_fused_views([(0, 0)], (9, 9), 1)
    assert needed == [(v, u) for v in range(5) for u in range(5)]
    assert set(list_fused_views([(4, 4)], (9, 9), 1)) == {(v, u) for v in range(1, 8) for u in range(1, 8)}


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("view", [(0, 0), (5, 5), (10, 3), (8, 9)])
def test_the_listed_views_are_enough(view, stride):
    grid, asked = (11, 10), []
    views = make_views(grid)
    fusing = FusingUpscaler(
        Upscaling(), grid, stride, fusion="always", matches=True, is_jpeg=False, fetch=asked.extend, cores=1
    )
    fusing({other: views[other] for other in list_fused_views([view], grid, stride)}, [view])
    assert not asked


def test_each_mean_of_a_row_is_taken_once(monkeypatch):
    axes = []
    fuse = fusion_views.fuse_lumas
    monkeypatch.setattr(fusion_views, "fuse_lumas", lambda *args: axes.append(args[3]) or fuse(*args))
    fusing = make_upscaler(Upscaling(), make_views())
    for v in range(6):
        fusing({}, [(v, u) for u in range(5)])
    assert axes.count(0) == axes.count(1) == 30


@pytest.mark.parametrize(("side", "most"), [(16, 12), (200, 3), (600, 3)])
def test_few_large_views_are_upscaled_at_once(side, most):
    views, counts = {view: np.zeros((side, side, 1), np.uint8) for view in np.ndindex(GRID)}, []

    class Counting(Upscaling):
        def __call__(self, views, wanted, grid):
            counts.append(len(wanted))
            return super().__call__(views, wanted, grid)

    fusing = make_upscaler(Counting(), views)
    fusing._upscale_views(list(views)[:12])
    assert max(counts) == most


def test_noise_is_a_share_of_the_bits_that_are_used(monkeypatch):
    noises = []
    monkeypatch.setattr(fusion_views, "match_views", lambda picture, *_, noise, **__: noises.append(noise) or picture)
    finishing = Finishing(sampling=Sampling("means", likeness=1.0, gain=1.0, noise=0.01))
    for dtype, level in ((np.uint8, 200), (np.uint8, 25), (np.uint16, 51_200), (np.uint16, 800)):
        views = {view: (picture * (level / 200)).astype(dtype) for view, picture in make_views().items()}
        make_upscaler(Upscaling(finishing, noise=0), views, matches=True)({}, [(2, 2)])
    np.testing.assert_allclose(noises, noises[0], rtol=0.1)  # 25 levels are coarse


def test_missing_views_are_fetched_once():
    views, fetched = make_views(), []

    def fetch(some):
        fetched.extend(some)
        return {view: views[view] for view in some}

    upscale = Upscaling()
    fusing = FusingUpscaler(upscale, GRID, 1, fusion="always", matches=False, is_jpeg=False, fetch=fetch, cores=1)
    partial(fusing, {})([(3, 2)])
    fusing({}, [(3, 3)])
    assert len(fetched) == len(set(fetched))
