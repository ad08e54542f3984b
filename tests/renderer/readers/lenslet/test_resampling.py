import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.lenslet.grid import LensGrid
from ciir.renderer.readers.lenslet.resampling import fit_pixels, place_views, resample_views
from tests.support.inputs import make_picture

SHAPES = st.sampled_from(["square", "hexagonal"])


@pytest.mark.parametrize("pickup", ["virtual", "optical"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_whole_numbers_are_pixel_mapping(pickup, dtype):
    picture = make_picture(42, 63, dtype=dtype)
    views = resample_views(picture, LensGrid(7.0, (3.0, 3.0)), (7, 7), pickup=pickup)
    assert np.array_equal(views, LightField.from_eia(picture, rows=6, cols=9, pickup=pickup).views)


@settings(max_examples=20)
@given(st.floats(7, 15), st.floats(0, 14), st.floats(0, 14), st.floats(-5, 5), SHAPES)
def test_samples_lie_where_the_grid_says(pitch, y, x, rotation, shape):
    """A picture that is linear in y and in x shows the place of each sample."""
    size, pixels = (220, 260), (5, 3)
    ramps = np.moveaxis((np.mgrid[: size[0], : size[1]] * 200).astype(np.uint16), 0, -1)
    grid = LensGrid(pitch, (y, x), rotation, shape)
    views = resample_views(ramps, grid, pixels)
    rows, along = place_views(grid, size, pixels)
    for v, u in np.ndindex(*pixels):
        places = grid.find_positions(rows[:, None], along) + np.array([v - 2, u - 1]) @ grid.axes
        wrong = np.abs(views[v, u] / 200 - places)
        # Splines end flat at borders, the picture's and a hexagonal row's.
        assert wrong[2:-2, 6:-6].max() < 0.02


@given(st.floats(7, 15), st.floats(-45, 45), SHAPES, st.tuples(st.integers(90, 300), st.integers(90, 300)))
def test_all_samples_lie_in_the_picture_and_fill_it(pitch, rotation, shape, size):
    grid, pixels = LensGrid(pitch, (3.0, 4.0), rotation, shape), (3, 3)
    rows, along = place_views(grid, size, pixels)
    corners = grid.find_positions(rows[[0, -1]][:, None], along[[0, -1]]).reshape(-1, 1, 2)
    reach = np.array([(v, u) for v in (-1, 1) for u in (-1, 1)]) @ grid.axes
    assert (corners + reach > -0.51).all()
    assert (corners + reach < np.array(size) - 0.49).all()
    if abs(rotation) < 1:
        lenses = np.prod(size) / pitch**2 / (1 if shape == "square" else 0.75)
        assert len(rows) * len(along) > 0.5 * lenses


def test_pixels_that_fit_lie_in_the_cell():
    assert [fit_pixels(LensGrid(pitch, (0, 0))) for pitch in (14.37, 15.0, 14.98, 16.0)] == [13, 15, 15, 15]
    assert fit_pixels(LensGrid(14.37, (0, 0), shape="hexagonal")) == 9


def test_a_picture_smaller_than_a_lens_is_refused():
    with pytest.raises(InvalidOption, match=r"no lens of 20.00 pixels lies wholly in the picture of 15x18 pixels"):
        resample_views(make_picture(15, 18), LensGrid(20.0, (30.0, 30.0)), (17, 17))


def test_a_hexagonal_grid_of_one_column_has_lenses_to_resample():
    views = resample_views(make_picture(24, 91), LensGrid(9.92, (183.13, 103.3), 15.26, "hexagonal"), (7, 2))
    assert views.shape[3] == 1
