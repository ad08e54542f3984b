import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.focus.apertures import make_aperture, read_aperture


def test_a_disc():
    weights = make_aperture((5, 4), 1.2)
    v, u = np.mgrid[-2:3, -1.5:2]
    assert (weights[np.hypot(v, u) <= 0.7] == 1).all()
    assert (weights[np.hypot(v, u) >= 1.7] == 0).all()
    assert weights[1, 1] == pytest.approx(1.7 - np.hypot(1, 0.5))


def test_a_square_and_a_beam():
    square = make_aperture((5, 5), 1, "square")
    assert square[2].tolist() == [0, 0.5, 1, 0.5, 0]
    assert square[1].tolist() == [0, 0.5, 0.5, 0.5, 0]
    beam = make_aperture((5, 5), 2, "gauss")
    assert beam[2, 2] == 1
    assert beam[2, 4] == pytest.approx(np.exp(-2))
    np.testing.assert_allclose(beam, beam.T)


def test_what_is_no_aperture():
    with pytest.raises(InvalidOption, match="a radius of 0 views lets no view through"):
        make_aperture((4, 4), 0)
    with pytest.raises(InvalidOption, match="a radius of 0 views lets no view through"):
        make_aperture((5, 5), 0, "gauss")
    with pytest.raises(InvalidOption, match=r"a radius of 0.05 views lets no view through"):
        make_aperture((8, 8), 0.05, "gauss")  # weights over 0 in 64 bits alone
    with pytest.raises(InvalidOption, match="shape: 'star' is not known; give disc, square, gauss"):
        read_aperture(None, (4, 4), "star")
    with pytest.raises(InvalidOption, match=r"aperture: 'nan' is not a number"):
        read_aperture(np.nan, (2, 2))
    with pytest.raises(InvalidOption, match=r"aperture: 'wide' is not a number"):
        read_aperture("wide", (2, 2))


@pytest.mark.parametrize("weights", [np.ones((2, 3)), np.zeros((2, 2)), -np.ones((2, 2)), np.full((2, 2), np.nan)])
def test_weights_that_are_none(weights):
    with pytest.raises(InvalidOption, match=r"aperture: .* give 2x2 numbers from 0"):
        read_aperture(weights, (2, 2))
