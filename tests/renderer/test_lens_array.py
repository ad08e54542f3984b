import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import InvalidOption
from ciir.renderer.lens_array import MAX_LENSES, MAX_PIXELS, TANGENT_RANGE, LensArray

COUNTS = st.integers(1, 40)
LENGTHS = st.floats(1e-6, 1e6)
SETTINGS = settings(max_examples=80)
ARRAYS = st.builds(LensArray, COUNTS, COUNTS, COUNTS, COUNTS, pitch=LENGTHS, delta=LENGTHS)


@SETTINGS
@given(array=ARRAYS)
def test_positions_and_tangents_one_by_one(array: LensArray) -> None:
    pitch, delta = array.pitch, array.delta
    xs = [(x - (array.cols - 1) / 2) * pitch for x in range(array.cols)]
    ys = [((array.rows - 1) / 2 - y) * pitch for y in range(array.rows)]
    txs = [(u - (array.pixels_u - 1) / 2) * delta for u in range(array.pixels_u)]
    tys = [((array.pixels_v - 1) / 2 - v) * delta for v in range(array.pixels_v)]
    for fast, slow in (
        (array.lens_x(), xs),
        (array.lens_y(), ys),
        (array.tangent_x(), txs),
        (array.tangent_y(), tys),
    ):
        assert fast.dtype == np.float64
        assert fast.tolist() == slow


@SETTINGS
@given(array=ARRAYS, scale=st.integers(1, 8))
def test_refined_cells_tile_the_coarse_ones(array: LensArray, scale: int) -> None:
    fine = array.refine(scale)
    assert (fine.rows, fine.cols) == (scale * array.rows, scale * array.cols)
    assert (fine.pixels_v, fine.pixels_u, fine.delta) == (array.pixels_v, array.pixels_u, array.delta)
    assert fine.width == pytest.approx(array.width)
    assert fine.height == pytest.approx(array.height)
    for coarse, refined in ((array.lens_x(), fine.lens_x()), (array.lens_y(), fine.lens_y())):
        centres = refined.reshape(-1, scale).mean(axis=1)
        assert np.allclose(centres, coarse, rtol=0, atol=1e-9 * array.pitch * len(refined))


@pytest.mark.parametrize(("pixels_v", "pixels_u"), [(15, 15), (1, 8), (9, 1)])
def test_delta_defaults_to_the_tangent_range_over_the_longer_side(pixels_v: int, pixels_u: int) -> None:
    array = LensArray(2, 2, pixels_v, pixels_u)
    assert array.delta * max(pixels_v, pixels_u) == pytest.approx(TANGENT_RANGE)
    assert array.refine(2).delta == array.delta


@pytest.mark.parametrize("field", ["rows", "cols", "pixels_v", "pixels_u"])
@pytest.mark.parametrize("beyond", [-1, 0, 1])
def test_counts_out_of_range(field: str, beyond: int) -> None:
    most = MAX_LENSES if field in ("rows", "cols") else MAX_PIXELS
    given_count = most + 1 if beyond == 1 else beyond
    option = "lenses" if field in ("rows", "cols") else "pixels"
    with pytest.raises(InvalidOption, match=f"^{option}: {given_count} is out of range; give 1 to {most} "):
        LensArray(**{"rows": 1, "cols": 1, "pixels_v": 1, "pixels_u": 1, field: given_count})


@pytest.mark.parametrize("count", [4.5, 4.0, "4"])
def test_counts_are_whole_numbers(count) -> None:
    with pytest.raises(InvalidOption, match=f"^lenses: {count} is out of range; give 1 to"):
        LensArray(count, 4, 3, 3)
    assert LensArray(np.int64(4), 4, 3, 3).rows == 4


@pytest.mark.parametrize(
    ("field", "length"),
    [
        ("pitch", "a"),
        ("pitch", 0.0),
        *((field, length) for field in ("pitch", "delta") for length in (-1.0, math.nan, math.inf, 1e10)),
    ],
)
def test_lengths_out_of_range(field: str, length: float) -> None:
    with pytest.raises(InvalidOption, match=rf"^{field}: .* is out of range; give a positive number"):
        LensArray(1, 1, 1, 1, **{field: length})


@pytest.mark.parametrize(
    ("scale", "message"), [(0, "^scale: 0 is out of range; give 1 or more"), (2, f"^lenses: {2 * MAX_LENSES} is out")]
)
def test_refining_out_of_range(scale: int, message: str) -> None:
    with pytest.raises(InvalidOption, match=message):
        LensArray(MAX_LENSES, 1, 1, 1).refine(scale)
