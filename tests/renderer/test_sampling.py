import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.sampling import MAX_SAMPLES, average_cells, check_samples


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_average_is_the_rounded_mean_over_each_lens_cell(samples):
    picture = np.random.default_rng(0).integers(0, 256, (5 * samples, 7 * samples, 4), dtype=np.uint8)
    averaged = average_cells(picture, samples)
    assert averaged.shape == (5, 7, 4)
    for y in range(5):
        for x in range(7):
            cell = picture[y * samples : (y + 1) * samples, x * samples : (x + 1) * samples].astype(float)
            assert np.abs(averaged[y, x] - cell.mean((0, 1))).max() <= 0.5


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_the_largest_sums_fit(channels):
    """256 samples of 255 and half their number for rounding are 65,408, near the end of 16 bits."""
    picture = np.full((32, 48, channels), 255, np.uint8)
    picture[16:, :16] = 254
    averaged = average_cells(picture, MAX_SAMPLES)
    np.testing.assert_array_equal(averaged[..., 0], [[255, 255, 255], [254, 255, 255]])


def test_samples_out_of_range():
    for samples in (0, 17):
        with pytest.raises(InvalidOption, match="1 to 16"):
            check_samples(samples)
