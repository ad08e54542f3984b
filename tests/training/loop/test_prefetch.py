import threading
import time

import pytest

pytest.importorskip("torch", reason="needs the training extra")

from ciir.training.loop.prefetch import prefetch_batches


@pytest.mark.parametrize("threads", [0, 1, 3, 20])
def test_order(threads):
    assert list(prefetch_batches(lambda step: (step, -step), 4, 11, threads=threads)) == [(s, -s) for s in range(4, 11)]


def test_prefetch_is_limited():
    made = []
    coming = prefetch_batches(lambda step: made.append(step) or (step, step), 0, 100, threads=2)
    next(coming)
    time.sleep(0.1)  # for batches that should not be made
    assert sorted(made) == [0, 1, 2]
    coming.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("batches")]


def test_the_end_waits_for_no_batch_that_has_not_begun():
    made, first, go = [], threading.Event(), threading.Event()

    def at(step):
        made.append(step)
        if step:
            first.set()
            go.wait()
        return step, step

    coming = prefetch_batches(at, 0, 100, threads=1, ready=18)
    next(coming)
    first.wait()  # 0 is done, 1 is being made, and 17 wait
    threading.Timer(0.05, go.set).start()
    coming.close()
    assert made == [0, 1]


def test_an_error_is_raised_at_its_batch():
    def at(step):
        return (1 // (2 - step), step)

    coming = prefetch_batches(at, 0, 9, threads=2)
    assert [next(coming)[1], next(coming)[1]] == [0, 1]
    with pytest.raises(ZeroDivisionError):
        next(coming)
