import threading

import pytest

from ciir.service.pipeline.stages.prefetch import READY, prefetch


def counted(count, made, closed=None, error_at=None):
    try:
        for number in range(count):
            if number == error_at:
                raise ValueError(str(number))
            made.append((number, threading.current_thread().name))
            yield number
    finally:
        if closed is not None:
            closed.append(threading.current_thread().name)


def threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("stage")]


@pytest.mark.parametrize("count", [0, 1, 2, 9])
def test_all_come_in_order_by_a_thread_of_their_own(count):
    made = []
    assert list(prefetch(counted(count, made), name="stage")) == list(range(count))
    assert [number for number, _ in made] == list(range(count))
    assert {name for _, name in made} <= {"stage_0"}
    assert threads() == []


def test_a_few_are_prefetched_and_closing_ends_it():
    made, closed = [], []
    coming = prefetch(counted(100, made, closed), name="stage")
    assert next(coming) == 0
    coming.close()
    assert len(made) <= 2 + READY
    assert closed == ["stage_0"]
    assert threads() == []


def test_an_error_comes_in_its_place():
    coming = prefetch(counted(9, [], error_at=2), name="stage")
    assert [next(coming), next(coming)] == [0, 1]
    with pytest.raises(ValueError, match="2"):
        next(coming)
    assert threads() == []
