import numpy as np
import pytest

from ciir.benchmarks.stress.networks import patterns


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (31, 8)])
def test_pictures_are_pictures(size):
    made = {"natural": patterns.natural(*size), **patterns.patterns(*size)}
    for name, picture in made.items():
        assert picture.shape == (3, *size), name
        assert picture.dtype == np.float32, name
        assert ((picture >= 0) & (picture <= 1)).all(), name


def test_what_the_names_say():
    made = patterns.patterns(6, 8)
    assert made["one hot pixel"].sum() == 3
    board = made["checkerboard"][0]
    assert (board[:, 1:] != board[:, :-1]).all()
    assert (board[1:] != board[:-1]).all()
    assert 0 < made["denormals"].min() == made["denormals"].max() < np.finfo(np.float32).tiny
    outside = patterns.outside(6, 8)
    assert all((picture < 0).any() or (picture > 1).any() for picture in outside.values())


def test_sinusoids_are_all_frequencies_of_a_picture():
    """Each lies on its own place of the discrete Fourier transform, and together on every one but conjugates."""
    side, places = 8, set()
    for wave in patterns.sinusoids(side, side // 2).values():
        energy = np.abs(np.fft.fft2(wave[0] - 0.5))
        peak = np.argwhere(energy > energy.max() / 2)
        places |= {tuple(place) for place in peak.tolist()}
    assert places == {(down, across) for down in range(side) for across in range(side)}


def test_natural_pictures_have_the_spectrum_of_photographs():
    """Amplitude falls as 1/frequency: from one octave to the next by a factor of 2, within the noise of one picture."""
    grey = patterns.natural(128, 128).mean(axis=0)
    amplitude = np.abs(np.fft.fft2(grey - grey.mean()))
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(128), np.fft.fftfreq(128)))
    rings = [amplitude[(frequency >= low) & (frequency < 2 * low)].mean() for low in (1 / 32, 1 / 16, 1 / 8)]
    assert rings[0] / rings[1] == pytest.approx(2, rel=0.25)
    assert rings[1] / rings[2] == pytest.approx(2, rel=0.25)
