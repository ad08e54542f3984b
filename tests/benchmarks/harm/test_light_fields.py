import numpy as np
import pytest

from ciir.benchmarks.harm import light_fields
from ciir.benchmarks.harm.light_fields import Variation
from ciir.errors import InvalidOption
from ciir.service.pipeline.options import Options
from tests.support.inputs import make_picture


def make_views(rows, cols, side=40):
    return np.stack([make_picture(side, side, seed=n) for n in range(rows * cols)]).reshape(rows, cols, side, side, 3)


def test_variations_have_every_value_of_every_factor():
    found = light_fields.list_variations((15, 15))
    assert len(set(found)) == len(found)
    assert {one.grid for one in found} == {(3, 3), (5, 5), (9, 9), (15, 15)}
    assert {one.noise for one in found} == {0, 2, 5}
    assert {(one.jpeg, one.is_interleaved) for one in found} == {
        (0, False), (90, False), (75, False), (90, True), (75, True)
    }  # fmt: skip
    clean = {(one.degradation, one.grid, one.place) for one in found if one.describe()["order"] == "right"}
    assert len(clean) == 3 * 4 * 3
    assert {(one.order, one.degradation) for one in found if one.grid == (5, 5)} == {
        *((order, kind) for order in ("right", "reversed", "transposed") for kind in ("bicubic", "box", "point")),
        ("exchanged", "box"),
        ("moved", "box"),
        ("rolled", "box"),
    }


@pytest.mark.parametrize(
    ("counts", "grids"), [((5, 5), {(3, 3), (5, 5)}), ((4, 6), {(3, 3), (4, 6)}), ((1, 1), {(1, 1)})]
)
def test_grids_are_those_that_the_input_has(counts, grids):
    assert {one.grid for one in light_fields.list_variations(counts)} == grids
    assert {one.grid for one in light_fields.list_variations(counts, quick=True)} <= grids


def test_jpeg_of_an_array_is_interleaved():
    found = light_fields.list_variations((9, 9), is_array=True)
    assert all(one.is_interleaved == bool(one.jpeg) for one in found)


@pytest.mark.parametrize("order", ["right", "reversed", "transposed"])
def test_the_wanted_view_keeps_its_content_in_every_order(order):
    views = make_views(3, 5)
    (case,) = light_fields.list_cases("noise", views, [Variation("box", (3, 5), "edge", order=order)])
    assert np.array_equal(case.truth, views[0, 2])
    low = views[0, 2].reshape(20, 2, 20, 2, 3).mean(axis=(1, 3))
    assert np.abs(case.views[case.at] - low).max() <= 0.5
    assert (case.views.shape[:2], case.at) == {
        "right": ((3, 5), (0, 2)), "reversed": ((3, 5), (2, 2)), "transposed": ((5, 3), (2, 0))
    }[order]  # fmt: skip
    assert case.options.views == f"{case.at[0]},{case.at[1]}"
    assert np.array_equal(case.source.views, case.views)


def test_two_views_are_exchanged_and_all_are_moved_or_rolled_with_their_truth():
    views = make_views(3, 5)
    exchanged, moved, rolled = light_fields.list_cases(
        "noise", views, [Variation("box", (3, 5), "edge", order=order) for order in light_fields.ERRORS]
    )
    low = views.reshape(3, 5, 20, 2, 20, 2, 3).mean(axis=(3, 5))
    differs = np.abs(exchanged.views - low).max(axis=(2, 3, 4)) > 0.5
    assert np.argwhere(differs).tolist() == [[1, 1], [1, 3]]
    assert np.abs(exchanged.views[1, [1, 3]] - low[1, [3, 1]]).max() <= 0.5
    for case in (moved, rolled):
        assert (np.abs(case.views - low).max(axis=(2, 3, 4)) > 0.5).sum() > 5
        own = case.truth.reshape(20, 2, 20, 2, 3).mean(axis=(1, 3))
        assert np.abs(case.views[case.at] - own).max() <= 0.5


def test_views_are_rolled_about_their_middle():
    """Each by its own angle, of up to half a degree: a gradient down gains a slope across."""
    gradient = np.broadcast_to(np.arange(128, dtype=np.uint8)[:, None, None], (3, 3, 128, 128, 3))
    rolled = light_fields.roll_views(gradient, np.random.default_rng(0)).astype(float)
    assert np.abs(rolled[..., 60:68, 60:68, :].mean((2, 3, 4)) - 63.5).max() <= 0.5
    slopes = (rolled[..., 8:-8, -9, 0] - rolled[..., 8:-8, 8, 0]).mean(2) / 111
    degrees = np.degrees(np.arctan(slopes))
    assert np.ptp(degrees) > 0.3
    assert np.abs(degrees).max() <= light_fields.ROLL + 0.05


def test_views_are_cropped_to_their_middle():
    views = make_views(1, 1, side=600)
    for kind, side in (("box", 256), ("point", 512)):
        cropped = light_fields.crop_views(views, kind)
        assert cropped.shape[2:4] == (side, side)
        assert np.array_equal(cropped[0, 0], views[0, 0, 300 - side // 2 :, 300 - side // 2 :][:side, :side])


def test_noise_and_jpeg_are_in_every_view():
    views = np.full((3, 3, 64, 64, 3), 100, np.uint8)
    noisy = light_fields.corrupt_views(views, Variation("box", (3, 3), noise=5), np.random.default_rng(0)).views
    assert np.all(np.abs(noisy.std(axis=(2, 3, 4)) - 5) < 0.3)
    textured = make_views(3, 3, 64)
    for is_interleaved in (False, True):
        variation = Variation("box", (3, 3), jpeg=75, is_interleaved=is_interleaved)
        made = light_fields.corrupt_views(textured, variation, np.random.default_rng(0))
        assert not made.is_jpeg or is_interleaved
        difference = made.views.astype(int) - textured
        assert np.all(np.abs(difference).mean(axis=(2, 3, 4)) > 1)
        assert np.all(np.abs(difference.mean(axis=(2, 3, 4))) < 3)


def test_small_views_are_refused():
    with pytest.raises(InvalidOption, match="views of 8x8 pixels; give views of 32x32"):
        light_fields.read_light_field("vase", "vase", Options(lenses=(8, 8), pixels=(3, 3)))
