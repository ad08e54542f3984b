import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.models.light_field.windows import WINDOW_SIDE, list_window, select_axis


@given(st.integers(1, 40).flatmap(lambda count: st.tuples(st.integers(0, count - 1), st.just(count))))
def test_a_window_holds_the_view_and_as_many_of_the_nearest_as_there_are(at):
    position, count = at
    views, present = select_axis(position, count)
    assert len(views) == WINDOW_SIDE
    assert all(0 <= view < count for view in views)
    there = [view for view, is_there in zip(views, present, strict=True) if is_there]
    assert there == [view for view in range(count) if abs(view - position) <= 2]
    assert views[WINDOW_SIDE // 2] == position
    assert present[WINDOW_SIDE // 2]
    assert {view for view, is_there in zip(views, present, strict=True) if not is_there} <= {position}


@pytest.mark.parametrize("position", [-1, 3])
def test_a_view_outside_the_grid_is_named(position):
    with pytest.raises(ValueError, match=f"view {position} of 3: give 0 to 2"):
        select_axis(position, 3)


def test_offsets_lead_from_the_view_to_those_around_it_row_by_row():
    found = list_window((0, 3), (6, 7))
    assert [view for view, _ in found] == [(v, u) for v in select_axis(0, 6).views for u in select_axis(3, 7).views]
    assert all((v - 0, u - 3) == offset for (v, u), offset in found)
    assert found[0] == ((0, 1), (0, -2))  # two rows above are beyond the border
