"""Edge scores against the same pixel by pixel."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from models import cells


def score_by_loops(some):
    """The same as `edge_scores`, pixel by pixel."""
    height, width, channels = some.shape
    levels = some.astype(float) * 255 / np.iinfo(some.dtype).max
    taps = (1, -4, 6, -4, 1)

    def at(row, col, channel):
        return levels[min(max(row, 0), height - 1), min(max(col, 0), width - 1), channel]

    rows, cols = -(-height // cells.CELL), -(-width // cells.CELL)
    values = [[[] for _ in range(cols)] for _ in range(rows)]
    for row in range(height):
        for col in range(width):
            for channel in range(channels):
                down = sum(tap * at(row + i - 2, col, channel) for i, tap in enumerate(taps))
                across = sum(tap * at(row, col + i - 2, channel) for i, tap in enumerate(taps))
                values[row // cells.CELL][col // cells.CELL].append(down**2 + across**2)
    return np.array([[np.mean(cell) for cell in line] for line in values])


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.integers(1, 19), st.integers(1, 19), st.sampled_from([1, 3]), st.sampled_from([np.uint8, np.uint16]))
def test_scores_are_the_mean_square_of_fourth_differences(height, width, channels, dtype):
    some = np.random.default_rng(height * width).integers(0, np.iinfo(dtype).max, (height, width, channels), dtype)
    # Sums of some hundred squares up to 1e7 in float32.
    assert np.allclose(cells.edge_scores(some), score_by_loops(some), rtol=1e-4, atol=1e-2)


def test_scores_in_bands_are_those_of_the_whole(monkeypatch):
    some = np.random.default_rng(1).integers(0, 256, (75, 61, 3), np.uint8)
    whole = cells.edge_scores(some)
    monkeypatch.setattr(cells, "BAND", 61 * 16)
    assert np.array_equal(cells.edge_scores(some), whole)
