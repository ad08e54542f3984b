"""The fit of a grid to the places of lenses."""

import numpy as np
import pytest

from ciir.renderer.readers.lenslet.refinement import _solve


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_places_that_are_far_off_do_not_count(share):
    random = np.random.default_rng(0)
    wanted = np.array([3.0, -2.0, 0.01])
    equations = random.normal(0, 1, (400, 2, 3)) * [1, 1, 50]  # the third unknown is a small one, as an angle
    places = equations @ wanted + random.normal(0, 0.02, (400, 2))
    places[: round(share * 400)] += 4
    found, middle = _solve(equations, places)
    assert found == pytest.approx(wanted, abs=5e-3)  # the noise divided by the root of 400, five times
    assert middle == pytest.approx(0.024, rel=0.4)  # the median of Rayleigh's distribution, and more with outliers
