import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.focus import planes
from ciir.renderer.focus.planes import refocus


def sinc(distance):
    """The kernel, before its weights are scaled to a sum of 1: Kaiser's window, over 3 pixels on each side."""
    inside = np.sqrt(1 - np.minimum(1, np.square(distance / 3)))
    return np.where(np.abs(distance) < 3, np.sinc(distance) * np.i0(5 * inside), 0)


def triangle(place, length):
    return planes.BORDER + (1 - planes.BORDER) * max(0, 1 - abs(2 * place + 1 - length) / length)


def look_up(signal, place, method):
    """The weight of `signal`, `(length, ...)`, at `place`, and its value there, or 0 and 0 outside."""
    length = len(signal)
    if method == "delta":
        place = np.ceil(place - 0.5)  # the nearest, that before where two are as near
    if not -0.5 <= place < length - 0.5:
        return 0.0, np.zeros(signal.shape[1:])
    pixels = np.arange(np.floor(place) - 3, np.floor(place) + 5)
    shares = sinc(pixels - place)
    extended = signal[pixels.clip(0, length - 1).astype(int)]
    value = np.tensordot(shares / shares.sum(), extended, 1)
    return (triangle(place, length) if method == "window" else 1.0), value


def refocus_slowly(views, disparity, weights, method):
    """The equation of the module, pixel by pixel."""
    count_v, count_u, height, width, channels = views.shape
    plane = np.zeros((height, width, channels))
    for y, x in np.ndindex(height, width):
        reached = 0.0
        for v, u in np.ndindex(count_v, count_u):
            weight_y, line = look_up(views[v, u], y - disparity * (v - (count_v - 1) / 2), method)
            if weight_y:
                weight_x, color = look_up(line, x - disparity * (u - (count_u - 1) / 2), method)
                plane[y, x] += weights[v, u] * weight_y * weight_x * color
                reached += weights[v, u] * weight_y * weight_x
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


def test_planes_in_batches_and_strips_are_the_same(monkeypatch):
    views = np.random.default_rng(2).random((2, 3, 20, 30, 3), np.float32)
    disparities = np.linspace(-2, 2, 7)
    expected = list(refocus(views, disparities))
    monkeypatch.setattr(planes, "MEMORY", 1)
    monkeypatch.setattr(planes, "_NUMBERS", 40)
    for plane, same in zip(refocus(views, disparities), expected, strict=True):
        np.testing.assert_allclose(plane, same, atol=1e-6)


@pytest.mark.parametrize("method", ["mapping", "window", "delta"])
def test_a_constant_light_field_stays_constant_to_its_borders(method):
    views = np.full((5, 5, 24, 31, 1), 0.8, np.float32)
    for plane in refocus(views, [-3.3, 0.0, 0.5, 4.0], method=method):
        np.testing.assert_allclose(plane, 0.8, atol=1e-6)  # float32


@pytest.mark.parametrize("count", [16, 17])  # the sums of 17x17 of the brightest pixels are over 16 bits
def test_whole_shifts_of_8_bits_are_exact(count):
    views = np.random.default_rng(4).integers(250, 256, (count, count, 20, 25, 1), np.uint8)
    (plane,) = refocus(views, [2.0 if count % 2 == 0 else 1.0], method="delta")
    (expected,) = refocus(views.astype(np.float64), [2.0 if count % 2 == 0 else 1.0], method="delta")
    np.testing.assert_allclose(plane, expected, rtol=1e-6)  # float32


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
    with pytest.raises(InvalidOption, match=r"aperture: .* give 2x2 numbers from 0"):
        next(refocus(np.ones((2, 2, 4, 4, 1)), [0.0], weights=weights))


def test_disparities_that_are_not_finite():
    with pytest.raises(InvalidOption, match="give finite numbers"):
        next(refocus(np.ones((2, 2, 4, 4, 1)), [np.inf]))


@pytest.mark.parametrize("method", ["mapping", "window", "delta"])
def test_views_that_are_far_outside_do_not_count(method):
    views = np.random.default_rng(3).random((3, 3, 9, 14, 1), np.float32)
    for plane in refocus(views, [20.0, -1e12], method=method):
        np.testing.assert_allclose(plane, views[1, 1], atol=1e-5)  # float32


def test_hidden_colours_do_not_count():
    views = np.zeros((3, 3, 8, 16, 4), np.uint8)
    views[..., 4:9, :] = 200, 100, 50, 255
    (plane,) = refocus(views, [1.0])
    assert np.allclose(plane[..., 3], refocus_slowly(views, 1.0, np.ones((3, 3)), "mapping")[..., 3], atol=1e-3)
    is_seen = plane[..., 3] > 1
    assert 0 < plane[is_seen][:, 3].min() < 100
    assert np.allclose(plane[is_seen][:, :3], (200, 100, 50), atol=0.01)  # float32: 50 * 255 is kept to 1e-3
