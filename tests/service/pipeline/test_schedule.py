"""Each view is made once, in time, and let go of when nothing needs it any more."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.service.pipeline.schedule import BATCH_PIXELS, at_once, turns


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.data(), st.tuples(st.integers(1, 8), st.integers(1, 8)), st.integers(1, 7), st.booleans())
def test_each_is_there_when_it_is_needed_and_made_once(data, grid, together, is_light_field):
    every = [(v, u) for v in range(grid[0]) for u in range(grid[1])]
    wanted = data.draw(st.lists(st.sampled_from(every), min_size=1, unique=True))
    in_order = turns(wanted, grid, together=together, is_light_field=is_light_field)
    assert [view for turn in in_order for view in turn.wanted] == wanted
    assert max(len(turn.wanted) for turn in in_order) <= together
    kept, made = set(), []
    reach = 2 if is_light_field else 0
    for turn in in_order:
        made += turn.new
        kept |= set(turn.new)
        near = {(v, u) for v, u in every for a, b in turn.wanted if abs(v - a) <= reach and abs(u - b) <= reach}
        assert near <= kept
        assert set(turn.done) <= kept
        kept -= set(turn.done)
    assert not kept
    assert len(made) == len(set(made))
    assert set(made) == {(v, u) for v, u in every for a, b in wanted if abs(v - a) <= reach and abs(u - b) <= reach}


@pytest.mark.parametrize("together", [1, 15])
def test_row_by_row_five_rows_are_kept(together):
    every = [(v, u) for v in range(15) for u in range(15)]
    kept = most = 0
    for turn in turns(every, (15, 15), together=together, is_light_field=True):
        kept += len(turn.new)
        most = max(most, kept)
        kept -= len(turn.done)
    assert most <= 5 * 15


def test_a_turn_is_bounded_by_its_pixels_and_holds_a_view_at_least():
    assert at_once(BATCH_PIXELS + 1) == at_once(BATCH_PIXELS) == 1
    assert at_once(BATCH_PIXELS // 12) == 12
