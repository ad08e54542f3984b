"""The matrices against the rays of the Geometry section, one point at a time."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.renderer.backends.projections import make_oblique_matrix
from ciir.renderer.lens_array import LensArray

SIDES = st.integers(1, 40)
LENGTHS = st.floats(0.01, 100)


@st.composite
def arrays(draw):
    return LensArray(draw(SIDES), draw(SIDES), draw(SIDES), draw(SIDES), draw(LENGTHS), draw(st.floats(0.001, 1)))


@settings(max_examples=60)
@given(arrays(), st.data())
def test_oblique_puts_a_point_of_a_ray_in_the_pixel_of_its_lens(array, data):
    y, x = data.draw(st.integers(0, array.rows - 1)), data.draw(st.integers(0, array.cols - 1))
    v, u = data.draw(st.integers(0, array.pixels_v - 1)), data.draw(st.integers(0, array.pixels_u - 1))
    distance = data.draw(st.floats(1, 50))
    # design.md, Geometry: the ray of lens (y, x) and pixel (v, u)
    lens = np.array([(x - (array.cols - 1) / 2) * array.pitch, ((array.rows - 1) / 2 - y) * array.pitch, 0.0])
    ray = np.array([(u - (array.pixels_u - 1) / 2) * array.delta, ((array.pixels_v - 1) / 2 - v) * array.delta, -1.0])
    point = lens + distance * ray
    clip = make_oblique_matrix(array, (v, u), 1.0, 50.0) @ [*point, 1.0]
    column = (clip[0] / clip[3] + 1) / 2 * array.cols - 0.5  # OpenGL: pixel i covers [i, i+1)
    row = (1 - clip[1] / clip[3]) / 2 * array.rows - 0.5
    np.testing.assert_allclose([row, column], [y, x], atol=1e-9 * max(array.rows, array.cols))
    np.testing.assert_allclose(clip[2], 2 * (distance - 1) / 49 - 1, atol=1e-9)
