import numpy as np
import pytest

from ciir.renderer.focus.stereo import sweep
from ciir.renderer.focus.stereo.sweep import Sweep


def kernel(distance):
    """Keys 1981, equation 15."""
    distance = abs(distance)
    if distance <= 1:
        return 1.5 * distance**3 - 2.5 * distance**2 + 1
    return -0.5 * distance**3 + 2.5 * distance**2 - 4 * distance + 2 if distance < 2 else 0.0


def look_up(line, at):
    """Where `at` lies between samples of `line` `(n, C)`, whose ends repeat; None outside."""
    first = int(np.floor(at))
    if not 0 <= first < len(line):
        return None
    return sum(kernel(at - (first + k)) * line[np.clip(first + k, 0, len(line) - 1)] for k in range(-1, 3))


def compare_slowly(views, view, disparity, distances):
    """Pixel by pixel: root mean squares on the side that agrees best, plus those of all views; NaN where none are."""
    height, width = views.shape[2:4]
    own = views[view]
    cost = np.zeros((height, width))
    for y, x in np.ndindex(height, width):
        sides = {}
        for axis, sign, distance in ((a, s, d) for a in (0, 1) for s in (-1, 1) for d in distances):
            place = np.add(view, sign * distance * np.eye(2, dtype=int)[axis])
            if not (place >= 0).all() or not (place < views.shape[:2]).all():
                continue
            other = views[tuple(place)]
            line, at = (other[:, x], y) if axis == 0 else (other[y], x)
            found = look_up(line, at - sign * distance * disparity)
            if found is not None:
                sides.setdefault((axis, sign), []).append(np.mean(np.square(found - own[y, x])))
        if not sides:
            cost[y, x] = np.nan
            continue
        every = [square for side in sides.values() for square in side]
        cost[y, x] = np.sqrt(min(np.mean(side) for side in sides.values())) + np.sqrt(np.mean(every))
    return cost


@pytest.mark.parametrize(
    ("grid", "view", "compared", "distances"),
    [
        ((5, 5), (2, 2), 2, (1, 2)),
        ((3, 4), (0, 3), 2, (1, 2)),
        ((1, 2), (0, 0), 2, (1, 2)),
        ((1, 9), (0, 4), 2, (2, 4)),
        ((1, 9), (0, 4), 3, (2, 3, 4)),
    ],
)
def test_is_the_slow_sum(monkeypatch, grid, view, compared, distances):
    monkeypatch.setattr(sweep, "MOST_DIFFERENCE", np.float32(1e6))
    views = np.random.default_rng(5).integers(0, 256, (*grid, 9, 12, 3)).astype(np.uint8)
    parts, planes = 4, [-7, -4, 0, 1, 6]
    cost = Sweep(views, view, parts=parts, farthest=max(distances), compared=compared).compare(planes)
    for plane, found in zip(planes, cost, strict=True):
        expected = compare_slowly(views.astype(float), view, plane / parts, distances)
        is_seen = np.isfinite(expected)
        assert is_seen.mean() > 0.3
        np.testing.assert_allclose(found[is_seen], expected[is_seen], rtol=1e-4)  # float32


def test_large_differences_count_as_one():
    views = np.zeros((1, 3, 4, 6, 1), np.uint8)
    views[0, 1] = 200
    cost = Sweep(views, (0, 1), parts=1, farthest=1).compare([0])
    np.testing.assert_allclose(cost, 2 * sweep.MOST_DIFFERENCE)


def test_pixels_that_no_view_reaches_fit_every_plane_alike():
    views = np.random.default_rng(6).integers(0, 256, (1, 2, 4, 6, 1)).astype(np.uint8)
    cost = Sweep(views, (0, 1), parts=1, farthest=1).compare([8, 9])  # the other view lies 8 pixels away
    assert np.ptp(cost, axis=0).max() == 0
    assert cost.min() >= sweep.MOST_DIFFERENCE  # as much as half of what fits badly
