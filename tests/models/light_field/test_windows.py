import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.models.light_field.windows import WINDOW_SIDE, find_middle, list_required_views, list_window, select_axis


@given(st.integers(1, 40).flatmap(lambda count: st.tuples(st.integers(0, count - 1), st.just(count))))
def test_a_window_holds_the_view_and_its_neighbours_inside_the_grid(place):
    position, count = place
    views, present = select_axis(position, count)
    assert len(views) == WINDOW_SIDE
    assert all(0 <= view < count for view in views)
    inside = [view for view, is_present in zip(views, present, strict=True) if is_present]
    # As many as fit, without a gap: no other such row of views is nearer to the view.
    assert inside == list(range(inside[0], inside[0] + min(count, WINDOW_SIDE)))
    assert abs(inside[0] + inside[-1] - 2 * position) == min(
        abs(2 * first + len(inside) - 1 - 2 * position) for first in range(count - len(inside) + 1)
    )
    assert [view for view, share in zip(views, present, strict=True) if share == 1] == [position]
    others = len(inside) - 1
    assert sorted(present) == [0] * (WINDOW_SIDE - 1 - others) + [0.5] * others + [1]
    assert views[len(inside) :] == (position,) * (WINDOW_SIDE - len(inside))
    assert not present[len(inside) :].any()


@pytest.mark.parametrize(
    ("position", "count", "views", "present"),
    [
        (4, 9, (2, 3, 4, 5, 6), [0.5, 0.5, 1, 0.5, 0.5]),
        (0, 9, (0, 1, 2, 3, 4), [1, 0.5, 0.5, 0.5, 0.5]),
        (1, 5, (0, 1, 2, 3, 4), [0.5, 1, 0.5, 0.5, 0.5]),
        (8, 9, (4, 5, 6, 7, 8), [0.5, 0.5, 0.5, 0.5, 1]),
        (1, 3, (0, 1, 2, 1, 1), [0.5, 1, 0.5, 0, 0]),
        (2, 3, (0, 1, 2, 2, 2), [0.5, 0.5, 1, 0, 0]),
        (0, 1, (0, 0, 0, 0, 0), [1, 0, 0, 0, 0]),
    ],
)
def test_windows_are_moved_inwards_and_end_where_a_small_grid_does(position, count, views, present):
    found = select_axis(position, count)
    assert found.views == views
    assert found.present.tolist() == present
    assert found.present.dtype == np.float32


@pytest.mark.parametrize("position", [-1, 3])
def test_a_view_outside_the_grid_is_refused(position):
    with pytest.raises(ValueError, match=f"view {position} of 3: give 0 to 2"):
        select_axis(position, 3)


def test_views_and_offsets_are_listed_row_by_row():
    found = list_window((0, 3), (6, 7))
    assert [view for view, _ in found] == [(v, u) for v in select_axis(0, 6).views for u in select_axis(3, 7).views]
    assert all((v - 0, u - 3) == offset for (v, u), offset in found)
    assert found[0] == ((0, 1), (0, -2))  # no row is above
    assert found[-1] == ((4, 5), (4, 2))


@pytest.mark.parametrize("rows", [3, 4, 5, 6, 9])
@pytest.mark.parametrize("cols", [3, 5, 8])
def test_the_middle_of_a_window_is_the_nearest_view_with_others_on_each_side(rows, cols):
    grid = rows, cols
    sides = [2 if count >= 5 else 1 for count in grid]
    inner = [(v, u) for v in range(sides[0], rows - sides[0]) for u in range(sides[1], cols - sides[1])]
    for view in np.ndindex(grid):
        nearest = min(inner, key=lambda other: abs(other[0] - view[0]) + abs(other[1] - view[1]))
        middle = find_middle(view, grid)
        assert middle == nearest
        assert set(list_required_views([middle], grid)) <= set(list_required_views([view], grid))


@given(st.integers(1, 12).flatmap(lambda count: st.tuples(st.integers(0, count - 1), st.just(count))))
def test_a_mirrored_axis_is_that_of_the_view_in_the_mirrored_grid(place):
    position, count = place
    own, expected = select_axis(position, count), select_axis(count - 1 - position, count)
    mirrored, places = own.mirror()
    assert mirrored.present.tolist() == expected.present.tolist()
    assert [count - 1 - view for view in mirrored.views] == list(expected.views)
    assert mirrored.views == tuple(own.views[place] for place in places)
