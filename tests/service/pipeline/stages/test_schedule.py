"""Each view is made once, before the first batch that needs it, and dropped after the last."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.service.pipeline.stages.arrangement import Arrangement
from ciir.service.pipeline.stages.schedule import BATCH_PIXELS, batch_size, schedule_batches


def list_near(wanted, grid, *, is_light_field):
    """The views of the windows around `wanted`, as many of 5x5 as the grid has; without a light field only these."""
    if not is_light_field:
        return set(wanted)
    firsts = [tuple(max(0, min(at - 2, count - 5)) for at, count in zip(view, grid, strict=True)) for view in wanted]
    return {
        (v, u)
        for top, left in firsts
        for v in range(top, min(top + 5, grid[0]))
        for u in range(left, min(left + 5, grid[1]))
    }


@settings(max_examples=60)
@given(st.data(), st.tuples(st.integers(1, 8), st.integers(1, 8)), st.integers(1, 7), st.booleans())
def test_each_view_is_made_once_and_in_time(data, grid, size, is_light_field):
    every = [(v, u) for v in range(grid[0]) for u in range(grid[1])]
    wanted = data.draw(st.lists(st.sampled_from(every), min_size=1, unique=True))
    batches = schedule_batches(wanted, Arrangement(grid), size=size, is_light_field=is_light_field)
    assert [view for batch in batches for view in batch.wanted] == wanted
    assert max(len(batch.wanted) for batch in batches) <= size
    kept, made = set(), []
    for batch in batches:
        made += batch.new
        kept |= set(batch.new)
        assert list_near(batch.wanted, grid, is_light_field=is_light_field) <= kept
        assert set(batch.done) <= kept
        kept -= set(batch.done)
    assert not kept
    assert len(made) == len(set(made))
    assert set(made) == list_near(wanted, grid, is_light_field=is_light_field)


@pytest.mark.parametrize("size", [1, 15])
def test_row_by_row_five_rows_are_kept(size):
    every = [(v, u) for v in range(15) for u in range(15)]
    kept = most = 0
    for batch in schedule_batches(every, Arrangement((15, 15)), size=size, is_light_field=True):
        kept += len(batch.new)
        most = max(most, kept)
        kept -= len(batch.done)
    assert most <= 5 * 15


def test_a_batch_is_bounded_by_its_pixels_and_holds_at_least_one_view():
    assert batch_size(BATCH_PIXELS + 1) == batch_size(BATCH_PIXELS) == 1
    assert batch_size(BATCH_PIXELS // 12) == 12
