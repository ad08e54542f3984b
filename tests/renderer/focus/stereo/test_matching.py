import numpy as np

from ciir.renderer.focus.stereo.matching import LARGE_STEP, SMALL_STEP, _add_path, match


def test_one_path_is_equation_13():
    """The path from the top alone, pixel by pixel, on a column of one pixel's width."""
    random = np.random.default_rng(3)
    cost = random.random((6, 9, 1), np.float32) * 10
    expected = [cost[:, 0, 0]]
    for row in range(1, 9):
        last = expected[-1]
        paths = [
            [last[other] + (0, SMALL_STEP, LARGE_STEP)[min(abs(plane - other), 2)] for other in range(6)]
            for plane in range(6)
        ]
        expected.append(cost[:, row, 0] + np.min(paths, axis=1) - last.min())
    total = np.zeros_like(cost)
    _add_path(total, cost, np.full((8, 1), LARGE_STEP, np.float32), range(9))
    np.testing.assert_allclose(total[:, :, 0].T, expected, rtol=1e-5)


def test_fits_between_planes():
    planes = np.linspace(-1, 1, 9)
    true = 0.3
    cost = np.broadcast_to(np.square(planes - true)[:, np.newaxis, np.newaxis] * 50, (9, 8, 7)).astype(np.float32)
    disparity, confidence = match(cost, np.zeros((3, 8, 7), np.float32), planes)
    np.testing.assert_allclose(disparity, true, atol=0.03)  # steps between neighbours bend the parabola a little
    assert confidence.min() > 0.9


def test_a_pixel_without_a_difference_takes_its_neighbours():
    planes = np.linspace(0, 4, 5)
    cost = np.broadcast_to(4 * np.abs(planes - 3)[:, np.newaxis, np.newaxis], (5, 9, 9)).astype(np.float32).copy()
    cost[:, 4, 4] = 0
    disparity, _ = match(cost, np.zeros((1, 9, 9), np.float32), planes)
    np.testing.assert_allclose(disparity, 3, atol=1e-5)
