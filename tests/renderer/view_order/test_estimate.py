"""The order of views: found in each wrong order, and never seen where it is right or where nothing shows it."""

import numpy as np
import pytest
from scipy import ndimage

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.view_set import reader as view_set
from ciir.renderer.readers.view_set.order import correct
from ciir.renderer.view_order import estimate
from ciir.renderer.view_order.estimate import estimate_order
from ciir.renderer.view_order.evidence import ORDERS
from tests.support.light_fields import is_same_light_field, make_views, put_in, wind
from tests.support.paths import SHARED

CAPTURED = SHARED / "data" / "lightfields"


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    "options",
    [
        {"grid": (3, 3)}, {"grid": (5, 5), "noise": 5.0}, {"grid": (4, 7), "channels": 3},
        {"grid": (9, 9), "channels": 4, "dtype": np.uint16}, {"grid": (3, 5), "disparities": (1, -1), "channels": 2},
        {"grid": (3, 3), "disparities": (12, 16), "side": 360},
    ],
)  # fmt: skip
def test_each_order_is_found_and_put_right(order, options):
    views = make_views(**options)
    given = put_in(order, views)
    found = estimate_order(given)
    assert (str(found), found.is_certain, found.is_likely) == (order, True, True)
    assert found.is_wrong == (order != "as given")
    right = correct(LightField(given), found).views
    assert is_same_light_field(right, views)
    assert np.shares_memory(right, given)
    wound = wind(given)
    found = estimate_order(wound)
    assert (found.order, found.is_serpentine, found.is_certain, found.is_wrong) == (order, True, True, True)
    assert is_same_light_field(correct(LightField(wound), found).views, views)


def make_near_views(grid):
    """Views whose content moves by a sixth of a pixel and a third from one to the next."""
    views = make_views(grid, side=6 * 96, disparities=(1, -2)).astype(float)
    small = ndimage.gaussian_filter(views.reshape(*grid, 96, 6, 96, 6, 1).mean(axis=(3, 5)) - 128, (0, 0, 1, 1, 0))
    return np.rint(128 + 40 / small.std() * small).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("grid", [(3, 3), (5, 6)])
def test_views_that_hardly_differ(order, grid, monkeypatch):
    given = put_in(order, make_near_views(grid))
    found = estimate_order(given)
    assert (str(found), found.is_certain) == (order, True)
    found = estimate_order(wind(given))
    assert (found.order, found.is_serpentine, found.is_certain) == (order, True, True)
    monkeypatch.setattr(estimate, "SLOPES", ())
    assert not estimate_order(wind(given)).is_serpentine


@pytest.mark.parametrize("views", [make_views(), make_near_views((3, 3))], ids=["far", "near"])
def test_16_bits_of_which_10_are_used_show_what_8_bits_do(views):
    given = put_in("transposed", views)
    assert estimate_order(given.astype(np.uint16) * 4) == estimate_order(given)


def test_one_axis_reversed_is_the_same_for_both_axes():
    views = make_views()
    for other in (views[::-1], views[:, ::-1]):
        assert estimate_order(other).order == "reversed along one axis"
    assert estimate_order(views[::-1, ::-1]).order == "as given"


@pytest.mark.parametrize(
    "views",
    [
        make_views((2, 9)), make_views((1, 1)), make_views(side=12), make_views(disparities=(0, 0), noise=5.0),
        np.full((3, 3, 60, 60, 3), 9, np.uint8), np.zeros((3, 3, 1, 1, 1), np.uint8),
        np.random.default_rng(0).integers(0, 256, (5, 5, 60, 60, 3), np.uint8),
    ],
    ids=["2 rows", "one view", "small", "at infinity", "one colour", "one pixel", "noise"],
)  # fmt: skip
def test_where_nothing_shows_the_order_none_is_wrong(views):
    for order in ORDERS:
        for given in (put_in(order, views), wind(put_in(order, views))):
            found = estimate_order(given)
            assert (str(found), found.is_likely) == ("as given", False)


def test_frames_of_a_film_are_no_light_field_in_another_order():
    frames = make_views((1, 25), disparities=(2, 2))[0]
    assert not estimate_order(frames.reshape(5, 5, *frames.shape[1:])).is_likely


def test_different_steps_down_and_across_are_not_taken_for_another_order():
    views = make_views((9, 5), disparities=(1, 1))[::2]
    assert not estimate_order(views).is_wrong


def exchange(views, one, other):
    """Views of which two are exchanged."""
    changed = views.copy()
    changed[one], changed[other] = views[other], views[one]
    return changed


@pytest.mark.parametrize("grid", [(5, 5), (4, 5), (9, 9), (3, 7)])
def test_two_views_that_are_exchanged_do_not_reorder_the_others(grid):
    v, u = (count // 2 for count in grid)
    found = estimate_order(exchange(make_views(grid), (v, u - 1), (v, u + 1)))
    assert (found.is_wrong, found.is_likely, found.is_contradicted) == (False, False, True)
    assert found.describe_contradiction().startswith("order: around the centre the views seem to be reversed in every ")
    assert estimate_order(make_views(grid)).describe_contradiction() == ""


@pytest.mark.parametrize("order", ORDERS[1:])
def test_a_wrong_order_in_which_two_views_are_exchanged_is_found(order):
    found = estimate_order(put_in(order, exchange(make_views(), (0, 0), (0, 1))))
    assert (found.order, found.is_wrong) == (order, True)


def test_rows_of_3x3_views_of_which_every_other_is_reversed_are_put_right():
    """There are no corners to compare: all views are looked at, and both readings of their order are the same."""
    found = estimate_order(exchange(make_views((3, 3)), (1, 0), (1, 2)))
    assert (found.is_serpentine, found.is_wrong) == (True, True)


@pytest.mark.parametrize(
    ("folder", "pattern", "grid"),
    [
        ("knights", "out_0[6-9]_0[6-9]_*.jpg", (4, 4)),
        ("knights", "out_1[0-4]_1[0-4]_*.jpg", (5, 5)),
        ("lytro-2067", "*_0[3-7]_0[3-7].png", (5, 5)),
        ("saii-5x5", "[1-3]_[1-3].png", (3, 3)),
    ],
)
@pytest.mark.skipif(not CAPTURED.is_dir(), reason="needs the captured light fields")
def test_captured_light_fields(folder, pattern, grid):
    files = {path.name: path.read_bytes() for path in (CAPTURED / folder).glob(pattern)}
    order = "columns" if folder == "saii-5x5" else "rows"  # {column}_{row}
    right = view_set.read(files, name=folder, layout=Layout(order=order)).load().views
    assert right.shape[:2] == grid
    noise = 5 * np.random.default_rng(0).standard_normal(right.shape, np.float32)
    for pictures in (right, np.clip(right + noise, 0, 255).astype(np.uint8)):
        for order in ORDERS:
            found = estimate_order(put_in(order, pictures))
            assert (str(found), found.is_certain) == (order, True)
            found = estimate_order(wind(put_in(order, pictures)))
            assert (found.order, found.is_serpentine, found.is_likely) == (order, True, True)


def test_rendered_light_fields():
    import ciir

    for name in ("vase", "globe", "hamburger"):
        views = ciir.render(f"scene:{name}", pixels=(5, 5), backend="raytrace").views
        assert {order: str(estimate_order(put_in(order, views))) for order in ORDERS} == {
            order: order for order in ORDERS
        }
