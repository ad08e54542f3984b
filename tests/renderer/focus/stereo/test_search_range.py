import numpy as np
import pytest

from ciir.renderer.focus.stereo.search_range import find_limits, find_reach, find_usual_range
from tests.support.light_fields import draw_layers


@pytest.mark.parametrize("layers", [(-6, -3), (-4, -1), (3, -6), (0, 0), (2, -2), (6, 3)])
@pytest.mark.parametrize("seed", [1, 4])
def test_all_layers_are_in_the_range(layers, seed):
    """The layer before the other covers a quarter of the view: its pixels are less sure than the median."""
    low, high = find_limits(draw_layers(*layers, seed=seed))
    assert min(layers) - 1 < low < min(layers) + 0.1
    assert max(layers) - 0.1 < high < max(layers) + 1


def test_the_usual_range_has_all_layers():
    assert find_usual_range(draw_layers(-4, -1)) == pytest.approx((-4, -1), abs=0.3)


@pytest.mark.parametrize(("size", "reach"), [((120, 160), 20), ((60, 80), 10), ((8, 8), 1), ((512, 512), 63)])
def test_how_far_is_searched(size, reach):
    assert find_reach(size) == reach


def give_coarse(monkeypatch, by_view):
    """Makes the disparities in small pictures those of `by_view`, elsewhere those of the centre."""
    module = "ciir.renderer.focus.stereo.search_range._look_coarsely"
    monkeypatch.setattr(module, lambda views, view, factor, window=1: by_view.get(view, by_view[2, 2]))


def test_corners_extend_the_range_of_the_centre(monkeypatch):
    give_coarse(monkeypatch, {(2, 2): np.linspace(0, 2, 1000), (4, 0): np.linspace(1, 5, 1000)})
    views = np.zeros((5, 5, 8, 8, 3), np.uint8)
    assert find_limits(views) == pytest.approx((0, 5), abs=0.5)
    assert find_limits(views, corners=False) == pytest.approx((0, 2), abs=0.3)


def test_disparities_far_from_all_others_in_a_corner_are_errors(monkeypatch):
    corner = np.append(np.linspace(0, 2, 900), np.linspace(-8, -7, 100))
    give_coarse(monkeypatch, {(2, 2): np.linspace(0, 2, 1000), (0, 0): corner, (4, 4): np.empty(0)})
    assert find_limits(np.zeros((5, 5, 8, 8, 3), np.uint8)) == pytest.approx((0, 2), abs=0.3)
