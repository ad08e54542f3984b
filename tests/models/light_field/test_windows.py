import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.models.light_field.windows import WINDOW_SIDE, list_window, select_axis


@given(st.integers(1, 40).flatmap(lambda count: st.tuples(st.integers(0, count - 1), st.just(count))))
def test_a_window_holds_the_view_and_its_neighbours_inside_the_grid(place):
    position, count = place
    views, present = select_axis(position, count)
    assert len(views) == WINDOW_SIDE
    assert all(0 <= view < count for view in views)
    inside = [view for view, is_present in zip(views, present, strict=True) if is_present]
    assert inside == [view for view in range(count) if abs(view - position) <= 2]
    assert views[WINDOW_SIDE // 2] == position
    assert present[WINDOW_SIDE // 2]
    assert {view for view, is_present in zip(views, present, strict=True) if not is_present} <= {position}


@pytest.mark.parametrize("position", [-1, 3])
def test_a_view_outside_the_grid_is_refused(position):
    with pytest.raises(ValueError, match=f"view {position} of 3: give 0 to 2"):
        select_axis(position, 3)


def test_views_and_offsets_are_listed_row_by_row():
    found = list_window((0, 3), (6, 7))
    assert [view for view, _ in found] == [(v, u) for v in select_axis(0, 6).views for u in select_axis(3, 7).views]
    assert all((v - 0, u - 3) == offset for (v, u), offset in found)
    assert found[0] == ((0, 1), (0, -2))  # two rows above are beyond the border
