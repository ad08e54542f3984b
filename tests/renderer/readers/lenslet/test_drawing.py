import numpy as np

from ciir.renderer.readers.lenslet.drawing import draw_grid
from ciir.renderer.readers.lenslet.grid import LensGrid


def test_levels_of_10_bits_fill_the_range():
    grid = LensGrid(8.0, (4.0, 4.0))
    picture = np.full((16, 16, 1), 1000, np.uint16)
    drawn = draw_grid(picture, grid)
    np.testing.assert_array_equal(drawn, draw_grid(picture << 6, grid))
    assert drawn[6, 6].tolist() == [250, 250, 250]
