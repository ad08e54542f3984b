import threading
import time

import pytest

from ciir.models.parallel import each, suits


def threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("abreast")]


@pytest.mark.parametrize("cores", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 9])
def test_each_is_done_once(cores, count):
    done = []
    each(done.append, range(count), cores)
    assert sorted(done) == list(range(count))
    assert threads() == []


def test_one_core_needs_no_thread():
    where = []
    each(lambda _: where.append(threading.current_thread()), range(3), 1)
    assert set(where) == {threading.current_thread()}


def test_as_many_at_once_as_there_are_cores():
    meeting = threading.Barrier(3, timeout=60)
    each(lambda _: meeting.wait(), range(6), 3)  # breaks where fewer than three meet


def test_the_first_error_is_raised_and_the_rest_is_not_begun():
    """The others may still be at what they have begun."""
    begun, wrong = [], threading.Event()

    def work(item):
        begun.append(item)
        if item == 1:
            wrong.set()
            raise ValueError("the second")
        wrong.wait(60)
        time.sleep(0.001)  # so that the caller has its turn long before all are done

    with pytest.raises(ValueError, match="the second"):
        each(work, range(10_000), 2)
    assert len(begun) < 10_000
    assert threads() == []


def test_few_calls_share_the_cores():
    assert [count for count in range(9) if suits(count, 2)] == [4, 5, 6, 7, 8]
    assert not suits(3, 2)
    assert not suits(1000, 1)
