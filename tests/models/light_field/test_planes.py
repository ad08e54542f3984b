"""Planes and the filters of a window."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.models.light_field.planes import LEAST, PHASE, REACH, Range, describe_window, place_planes, stagger
from ciir.models.light_field.windows import WINDOW_SIDE, select_axis

ENDS = st.floats(-2, 2)


@given(ENDS, ENDS, st.integers(2, 20))
def test_planes_are_evenly_spread_over_the_range(one, other, count):
    low, high = sorted((one, other))
    planes = place_planes(Range(low, high), count)
    steps = np.diff(planes)
    np.testing.assert_allclose(steps, max((high - low) / (count - 1), LEAST), atol=1e-12)
    assert planes.mean() == pytest.approx((low + high) / 2, abs=1e-12)


@given(ENDS, ENDS, st.integers(2, 20))
def test_staggered_planes_lie_in_the_middle_between_one_another_s(one, other, count):
    low, high = sorted((one, other))
    first, second = (place_planes(disparities, count) for disparities in stagger(Range(low, high), count))
    step = first[1] - first[0]
    np.testing.assert_allclose(second - first, step / 2, atol=step / count)  # the wider range has wider steps
    assert min(*first, *second) <= low
    assert max(*first, *second) >= high


@given(ENDS, st.floats(0, 2), st.sampled_from([(2, 5), (0, 5), (3, 4), (1, 3)]), st.integers(2, 12))
def test_filters_keep_a_flat_picture_and_skip_absent_views(low, width, place, count):
    axis = select_axis(*place)
    window = describe_window(axis, select_axis(2, 5), Range(low, low + width), count)
    assert window.down.shape == window.across.shape == (count, 3, WINDOW_SIDE, 2 * REACH + 1)
    np.testing.assert_allclose(window.down.sum((2, 3)), 1, atol=1e-5)
    assert not window.down[:, :, axis.present == 0].any()
    assert window.down.dtype == window.across.dtype == window.description.dtype == np.float32


def test_fine_samples_lie_where_they_should():
    """A ramp of views that move by each plane's disparity keeps its place."""
    axis = select_axis(1, 5)
    window = describe_window(axis, axis, Range(-0.75, 0.5), 6)
    taps, offsets = np.arange(-REACH, REACH + 1), np.arange(WINDOW_SIDE) - 1
    for plane, filters in zip(place_planes(Range(-0.75, 0.5), 6), window.down, strict=True):
        place = taps - plane * offsets[:, None]
        for samples, at in zip(filters[:2], (-PHASE, PHASE), strict=True):
            assert (samples * place).sum() == pytest.approx(at, abs=0.1)


def test_the_window_is_described():
    window = describe_window(select_axis(0, 5), select_axis(3, 4), Range(-1.0, 0.25), 8)
    np.testing.assert_array_equal(window.description, np.float32([0, 2, 1.5, 0, -1, 0.25]))


@given(ENDS, ENDS, st.sampled_from([(2, 5), (0, 5), (4, 5), (1, 3)]), st.sampled_from([(2, 5), (0, 4)]))
def test_trimming_leaves_out_nothing_but_zeros(one, other, down, across):
    low, high = sorted((one, other))
    whole = describe_window(select_axis(*down), select_axis(*across), Range(low, high), 6)
    trimmed = whole.trim()
    beyond = REACH - trimmed.down.shape[3] // 2
    for few, every in zip(trimmed[:2], whole[:2], strict=True):
        np.testing.assert_array_equal(np.pad(few, ((0, 0), (0, 0), (0, 0), (beyond, beyond))), every)
    outer = [filters[..., [0, -1]] for filters in trimmed[:2]]
    assert any(filters.any() for filters in outer)
