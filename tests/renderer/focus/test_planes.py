import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.focus import planes
from ciir.renderer.focus.planes import refocus


def keys(distance):
    """Keys 1981, equation 15."""
    distance = abs(distance)
    if distance <= 1:
        return 1.5 * distance**3 - 2.5 * distance**2 + 1
    return -0.5 * distance**3 + 2.5 * distance**2 - 4 * distance + 2 if distance < 2 else 0.0


def nearest(distance):
    """The kernel of `delta`: 1 at one whole pixel, that above where two are as near."""
    return float(-0.5 < distance <= 0.5)


def triangle(place, length):
    return planes.BORDER + (1 - planes.BORDER) * (1 - abs(2 * place + 1 - length) / length)


def refocus_slowly(views, disparity, weights, method):
    """The equation of the module, pixel by pixel."""
    count_v, count_u, height, width, channels = views.shape
    kernel = nearest if method == "delta" else keys
    plane = np.zeros((height, width, channels))
    for y, x in np.ndindex(height, width):
        reached = 0.0
        for v, u in np.ndindex(count_v, count_u):
            down = disparity * (v - (count_v - 1) / 2)
            across = disparity * (u - (count_u - 1) / 2)
            for row, col in np.ndindex(height, width):
                weight = kernel(y - row - down) * kernel(x - col - across)
                if weight:
                    weight *= weights[v, u]
                    if method == "window":
                        weight *= triangle(row, height) * triangle(col, width)
                    plane[y, x] += weight * views[v, u, row, col]
                    reached += weight
        plane[y, x] /= reached
    return plane


@pytest.mark.parametrize("method", ["mapping", "window", "delta"])
@pytest.mark.parametrize("disparity", [0.0, 1.3, -0.75])
@pytest.mark.parametrize("shape", [(3, 4, 9, 12, 3), (1, 5, 8, 7, 1)])
def test_is_the_mean_along_lines_of_the_light_field(shape, disparity, method):
    random = np.random.default_rng(1)
    views = random.random(shape, np.float32)
    weights = random.random(shape[:2]).astype(np.float32)
    weights[0, 1] = 0
    (plane,) = refocus(views, [disparity], weights=weights, method=method)
    assert plane.shape == shape[2:]
    np.testing.assert_allclose(plane, refocus_slowly(views, disparity, weights, method), atol=1e-5)  # float32


@pytest.mark.parametrize("kept", [0, planes.KEPT])
def test_planes_in_batches_are_the_same(monkeypatch, kept):
    views = np.random.default_rng(2).random((2, 3, 20, 30, 3), np.float32)
    disparities = np.linspace(-2, 2, 7)
    expected = list(refocus(views, disparities))
    monkeypatch.setattr(planes, "MEMORY", 1)
    monkeypatch.setattr(planes, "KEPT", kept)
    for plane, same in zip(refocus(views, disparities), expected, strict=True):
        np.testing.assert_allclose(plane, same, atol=1e-6)


@pytest.mark.parametrize("method", ["mapping", "window", "delta"])
def test_a_constant_light_field_stays_constant_to_its_borders(method):
    views, weights = np.full((5, 5, 24, 31, 1), 0.8, np.float32), np.ones((5, 5), np.float32)
    views[2, 2] = weights[2, 2] = 0  # sums are about the centre view's mean: 0.8 there would cancel exactly
    bound = 1e-5 if method == "window" else 1e-6  # float32; in a corner a window divides by 1/64
    for plane in refocus(views, [-3.3, 0.0, 0.5, 4.0], method=method, weights=weights):
        np.testing.assert_allclose(plane, 0.8, atol=bound)


def test_a_point_is_sharpest_at_its_disparity():
    views = np.zeros((5, 5, 41, 41, 1), np.float32)
    for v, u in np.ndindex(5, 5):
        views[v, u, 20 - 2 * (v - 2), 20 - 2 * (u - 2)] = 1  # 2 pixels to the left and up from view to view
    disparities = np.linspace(-4, 4, 33)
    at_point = [plane[20, 20, 0] for plane in refocus(views, disparities)]
    assert disparities[np.argmax(at_point)] == pytest.approx(2)
    assert max(at_point) == pytest.approx(1, abs=1e-5)


def test_pixels_that_no_view_reaches_are_zero():
    views = np.full((1, 2, 4, 10, 1), 9.0, np.float32)
    weights = np.array([[0, 1]], np.float32)
    (plane,) = refocus(views, [8.0], weights=weights)  # the second view, 4 pixels to the right
    np.testing.assert_allclose(plane[0, :, 0], [0] * 4 + [9] * 6, atol=1e-4)


@pytest.mark.parametrize("weights", [np.ones((2, 3)), np.zeros((2, 2)), -np.ones((2, 2)), np.full((2, 2), np.nan)])
def test_weights_that_are_none(weights):
    with pytest.raises(InvalidOption, match="weights: give 2x2 numbers from 0"):
        next(refocus(np.ones((2, 2, 4, 4, 1)), [0.0], weights=weights))


def test_disparities_that_are_not_finite():
    with pytest.raises(InvalidOption, match="give finite numbers"):
        next(refocus(np.ones((2, 2, 4, 4, 1)), [np.inf]))


@pytest.mark.parametrize("method", ["mapping", "window", "delta"])
def test_views_that_are_far_outside_do_not_count(method):
    views = np.random.default_rng(3).random((3, 3, 9, 14, 1), np.float32)
    for plane in refocus(views, [20.0, -1e12], method=method):
        np.testing.assert_allclose(plane, views[1, 1], atol=1e-5)  # float32
