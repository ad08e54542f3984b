"""Windows of every second or third view."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.models import catalogue
from ciir.models.light_field.strides import choose_stride, list_spaced_views, upscale_spaced_views
from ciir.models.light_field.views import upscale_views
from ciir.models.light_field.windows import list_required_views

GRIDS = st.tuples(st.integers(1, 14), st.integers(1, 14))


@pytest.mark.parametrize(
    ("motion", "grid", "stride"),
    [
        (None, (15, 15), 1),
        (0.8, (15, 15), 1),
        (0.37, (15, 15), 1),
        (0.36, (15, 15), 2),
        (0.25, (15, 15), 2),
        (0.24, (15, 15), 3),
        (0.0, (15, 15), 3),
        (0.0, (14, 15), 2),  # three apart some windows would have four rows
        (0.0, (15, 9), 1),
        (0.0, (3, 3), 1),
    ],
)
def test_content_moves_by_little_within_a_window_that_fits(motion, grid, stride):
    assert choose_stride(motion, grid) == stride


@given(st.data(), GRIDS, st.integers(1, 3))
def test_windows_are_those_of_every_so_many_th_view(data, grid, stride):
    v, u = (data.draw(st.integers(0, side - 1)) for side in grid)
    rows, cols = (list(range(at % stride, side, stride)) for at, side in zip((v, u), grid, strict=True))
    expected = [
        (rows[row], cols[col])
        for row, col in list_required_views([(rows.index(v), cols.index(u))], (len(rows), len(cols)))
    ]
    assert list_spaced_views([(v, u)], grid, stride) == expected


def test_each_view_is_upscaled_as_in_the_light_field_of_every_second_one():
    network = catalogue.load_light_field_network("field")
    fallback = catalogue.load_upscaler("fast")
    shared = np.random.default_rng(0).integers(60, 200, (20, 24, 3)).astype(np.uint8)
    views = {(v, u): np.roll(shared, (v + 2 * u) % 3, axis=1) for v in range(9) for u in range(10)}
    wanted = [(4, 5), (0, 0), (4, 6), (8, 9), (4, 7)]
    upscale = partial(upscale_views, network, fallback)
    made, finished = upscale_spaced_views(upscale, views, wanted, (9, 10), 2)
    for view, picture, how in zip(wanted, made, finished, strict=True):
        rows, cols = range(view[0] % 2, 9, 2), range(view[1] % 2, 10, 2)
        inside = {(r, c): views[row, col] for r, row in enumerate(rows) for c, col in enumerate(cols)}
        alone, expected = upscale(inside, [(view[0] // 2, view[1] // 2)], (len(rows), len(cols)))
        np.testing.assert_array_equal(picture, alone[0])
        assert [how] == expected
    needed = {view: views[view] for view in list_spaced_views(wanted, (9, 10), 2)}
    np.testing.assert_array_equal(upscale_spaced_views(upscale, needed, wanted, (9, 10), 2)[0], made)
