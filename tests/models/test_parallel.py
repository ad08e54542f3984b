import threading
import time

import pytest

from ciir.models.parallel import is_parallel_faster, run_each


def list_threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("parallel")]


@pytest.mark.parametrize("cores", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 9])
def test_each_item_is_worked_on_once(cores, count):
    done = []
    run_each(done.append, range(count), cores)
    assert sorted(done) == list(range(count))
    assert list_threads() == []


def test_one_core_needs_no_thread():
    used = []
    run_each(lambda _: used.append(threading.current_thread()), range(3), 1)
    assert set(used) == {threading.current_thread()}


def test_as_many_at_once_as_there_are_cores():
    meeting = threading.Barrier(3, timeout=60)
    run_each(lambda _: meeting.wait(), range(6), 3)  # breaks where fewer than three meet


def test_the_first_error_is_raised_and_later_items_are_left_out():
    """Other threads may still be working on theirs."""
    begun, failed = [], threading.Event()

    def work(item):
        begun.append(item)
        if item == 1:
            failed.set()
            raise ValueError("the second")
        failed.wait(60)
        time.sleep(0.001)  # so that the caller runs long before all items are done

    with pytest.raises(ValueError, match="the second"):
        run_each(work, range(10_000), 2)
    assert len(begun) < 10_000
    assert list_threads() == []


def test_few_calls_are_faster_one_after_the_other():
    assert [calls for calls in range(9) if is_parallel_faster(calls, 2)] == [4, 5, 6, 7, 8]
    assert not is_parallel_faster(3, 2)
    assert not is_parallel_faster(1000, 1)
