import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.errors import InvalidOption
from ciir.renderer.readers.lenslet.grid import LensGrid

GRIDS = st.builds(
    LensGrid,
    st.floats(5, 40),
    st.tuples(st.floats(0, 40), st.floats(0, 40)),
    st.floats(-45, 45),
    st.sampled_from(["square", "hexagonal"]),
)


@given(GRIDS, st.tuples(st.floats(-100, 100), st.floats(-100, 100)))
def test_the_nearest_lens_is_the_nearest_of_all(grid, point):
    i, j = np.mgrid[-60:61, -60:61]
    distances = np.hypot(*np.moveaxis(grid.find_centers(i, j) - point, -1, 0))
    found = grid.find_centers(*grid.find_nearest(np.array(point)))
    assert np.hypot(*(found - point)) == pytest.approx(distances.min(), abs=1e-9)


@given(GRIDS)
def test_every_lens_has_neighbours_at_the_pitch(grid):
    neighbours = [(0, 1), (0, -1), (1, 0), (-1, 0)]
    if grid.shape == "hexagonal":
        neighbours += [(1, -1), (-1, -1)]  # of lens (0, 0), in an even row
    i, j = np.array(neighbours).T
    assert np.allclose(np.hypot(*(grid.find_centers(i, j) - grid.offset).T), grid.pitch)


def test_rows_of_a_positive_rotation_go_down_to_the_right():
    y, x = LensGrid(10.0, (0.0, 0.0), 30.0).find_centers(np.array(0), np.array(1))
    assert (y, x) == pytest.approx((5.0, 8.66), abs=0.01)


def test_a_pitch_out_of_range_is_refused():
    with pytest.raises(InvalidOption, match="lens_pitch: 3 is out of range; give 5 to 200 pixels"):
        LensGrid(3.0, (0.0, 0.0))
