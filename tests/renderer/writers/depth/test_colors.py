import numpy as np
import pytest

from ciir.renderer.writers.depth.colors import color_map


def test_is_viridis():
    matplotlib = pytest.importorskip("matplotlib", reason="needs the bench extra")
    values = np.linspace(-3, 5, 256)[np.newaxis]
    expected = matplotlib.colormaps["viridis"](np.linspace(0, 1, 256))[np.newaxis, :, :3] * 255
    assert np.abs(color_map(values, -3, 5) - expected).max() <= 4  # of 255: how far the polynomial is from it


def test_values_outside_have_the_colours_of_the_ends():
    low, first, last, high = color_map(np.array([[-1, 0, 1, 2]]), 0, 1)[0].tolist()
    assert low == first != last == high


def test_a_flat_map_has_one_colour():
    assert len(np.unique(color_map(np.full((2, 3), 0.7), 0.7, 0.7).reshape(-1, 3), axis=0)) == 1
