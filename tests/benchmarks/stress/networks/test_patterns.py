import numpy as np
import pytest

from ciir.benchmarks.stress.networks import patterns


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (31, 8)])
def test_pictures_are_pictures(size):
    made = {"natural": patterns.make_natural(*size), **patterns.make_patterns(*size)}
    for name, picture in made.items():
        assert picture.shape == (3, *size), name
        assert picture.dtype == np.float32, name
        assert ((picture >= 0) & (picture <= 1)).all(), name


def test_patterns_are_what_they_are_called():
    made = patterns.make_patterns(6, 8)
    assert made["one hot pixel"].sum() == 3
    board = made["checkerboard"][0]
    assert (board[:, 1:] != board[:, :-1]).all()
    assert (board[1:] != board[:-1]).all()
    assert 0 < made["denormals"].min() == made["denormals"].max() < np.finfo(np.float32).tiny
    outside = patterns.make_outside(6, 8)
    assert all((picture < 0).any() or (picture > 1).any() for picture in outside.values())


def test_sinusoids_are_all_frequencies_of_a_picture():
    """Each lies on its own place of the discrete Fourier transform, and together on every one but conjugates."""
    side, places = 8, set()
    for wave in patterns.make_sinusoids(side, side // 2).values():
        energy = np.abs(np.fft.fft2(wave[0] - 0.5))
        peak = np.argwhere(energy > energy.max() / 2)
        places |= {tuple(place) for place in peak.tolist()}
    assert places == {(down, across) for down in range(side) for across in range(side)}
