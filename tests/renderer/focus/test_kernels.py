import numpy as np
import pytest

from ciir.renderer.focus.kernels import make_sinc_taps, make_taps


def keys(distance):
    """Keys 1981, equation 15."""
    distance = abs(distance)
    if distance <= 1:
        return 1.5 * distance**3 - 2.5 * distance**2 + 1
    return -0.5 * distance**3 + 2.5 * distance**2 - 4 * distance + 2 if distance < 2 else 0.0


@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.5, 1.0])
def test_taps_are_samples_of_the_kernel_of_keys(fraction):
    np.testing.assert_allclose(make_taps(np.array(fraction)), [keys(fraction - offset) for offset in range(-1, 3)])


@pytest.mark.parametrize(
    ("make", "offsets", "bound"), [(make_taps, range(-1, 3), 0.032), (make_sinc_taps, range(-2, 4), 0.003)]
)
def test_waves_are_shifted(make, offsets, bound):
    """By any fraction, up to a quarter of a cycle a pixel: the module states the errors."""
    frequencies = np.linspace(0, 0.25, 50)
    fractions = np.linspace(0, 1, 21)
    waves = np.exp(2j * np.pi * np.multiply.outer(frequencies, offsets))  # (frequencies, taps)
    moved, exact = make(fractions) @ waves.T, np.exp(2j * np.pi * np.multiply.outer(fractions, frequencies))
    assert np.sqrt(np.square(np.abs(moved - exact)).mean()) < bound
    np.testing.assert_allclose(make(fractions).sum(axis=-1), 1, atol=1e-12)


def test_a_whole_shift_is_one_pixel():
    assert make_sinc_taps(np.array([0.0, 1.0])).tolist() == [[0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0]]
