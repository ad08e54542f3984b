"""After a power cut at any moment no accepted job is lost, and no job that is done lacks its result."""

import shutil
import tempfile
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from ciir.service.jobs.job import FINAL
from ciir.service.jobs.lanes import LANES
from ciir.service.jobs.workers import worker
from ciir.service.jobs.workers.consumer import Consumer
from ciir.service.jobs.workers.consumer_lock import ConsumerLock
from ciir.service.jobs.workers.pool import Pool
from ciir.service.jobs.workers.recovery import STALE_SECONDS, Recovery
from ciir.service.jobs.workers.task import Hooks
from ciir.service.settings import Settings
from tests.service.jobs.failures import power_cuts
from tests.support.inputs import make_picture
from tests.support.jobs import JobService, StandInPool, read_result
from tests.support.workers.pools import COLD

pytestmark = pytest.mark.slow

OPTIONS = {"lenses": "4x5", "model": "none"}
RUN = """
import sys, threading
from hashlib import sha256
from pathlib import Path
from ciir.service.jobs.identity import compute_id
from ciir.service.jobs.job import Request
from tests.service.jobs.failures.power_cuts import mark
from tests.service.jobs.failures.test_power_cuts import OPTIONS, make_eia, open_pool
from tests.support.jobs import JobService, StandInPool, submit_data, wait_for_end
from tests.support.waiting import wait_until

def submit(number):
    data = make_eia(number)
    request = Request("upload.png", OPTIONS, None)
    mark("any", compute_id(request, sha256(data).hexdigest(), jobs._limits), str(number))
    job = submit_data(jobs, data, **OPTIONS)
    mark("accepted", job.id, str(number))
    return job

def finish(job):
    assert wait_for_end(jobs, job.id).state == "done"
    mark("done", job.id)

def work(*args):
    gate.wait()
    return run_in_worker(*args)

service = JobService(Path(sys.argv[1], "service"))
jobs, gate = service.open_jobs(), threading.Event()
gate.set()
with open_pool(2) as run_in_worker:
    service.start_consumer(jobs, StandInPool(work), 2)
    number = 0
    for _ in range(int(sys.argv[2])):
        finish(submit(number))
        gate.clear()
        waiting = [submit(number + 1 + index) for index in range(3)]
        mark("any", waiting[1].id)
        assert jobs.cancel(waiting[1].id).state == "cancelled"
        mark("cancelled", waiting[1].id)
        gate.set()
        finish(waiting[0])
        submit(number)
        mark("done", submit(number).id)
        finish(submit(number + 2))
        finish(waiting[2])
        number += 4
    wait_until(lambda: not jobs.queue.active.items())
    service.close()
"""


def make_eia(number):
    return encode_png(make_picture(12, 15, seed=number))


def is_view(result, number):
    """Whether `result` is the view that the job of `make_eia(number)` makes."""
    return np.array_equal(decode(result, name="view"), make_picture(12, 15, seed=number)[1::3, 1::3])


@contextmanager
def open_pool(workers):
    """What a `StandInPool` does in worker processes, which start without warm-up."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(worker, "MODULE", COLD)
        pool = Pool(Settings(workers=workers))
        try:
            yield lambda task, progress, cancelled: pool.run(task, Hooks(lambda _: None, progress, cancelled))
        finally:
            pool.close()


@pytest.fixture
def memory():
    """A folder in memory, where syncing takes no time."""
    shared = Path("/dev/shm")  # noqa: S108 - a folder of its own is made there
    with tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None) as folder:
        yield Path(folder)


def check(cut, folder, work):
    """Starts the service on what a power cut left; returns what clients knew of how many jobs."""
    cut.write(folder)
    expected = {id_: state for state, id_, *_ in map(str.split, cut.marks)}
    numbers = {id_: int(number[0]) for _, id_, *number in map(str.split, cut.marks) if number}
    service = JobService(folder / "service")
    jobs, pool, now = service.open_jobs(), StandInPool(work), [0.0]
    for job in (jobs.get(id_) for id_, state in expected.items() if state == "done"):
        assert job.state == "done"
        assert is_view(read_result(jobs, job.id), numbers[job.id])
    lock = ConsumerLock(jobs.folder)
    recovery = Recovery(jobs, lock, lambda: now[0])
    recovery.send_heartbeat()
    recovery.repair(())
    recovery.remove_leftovers()
    now[0] += 2 * STALE_SECONDS
    recovery.repair(())
    consumer = Consumer(jobs, pool, 1)
    while (id_ := jobs.queue.pop(LANES, 0)) is not None:
        run = consumer._start_run(id_, holds_small=False)
        if run is not None:
            consumer._run_job(run)
    assert not {id_ for id_ in pool.started if expected.get(id_) in ("done", "cancelled")}
    ended = {id_: jobs.get(id_) for id_ in jobs.queue.jobs.items()}
    assert {id_ for id_, state in expected.items() if state in ("accepted", "done")} <= set(ended)
    for id_, job in ended.items():
        assert job.state == ("cancelled" if expected[id_] == "cancelled" else "done") or expected[id_] == "any"
        if job.state == "done":
            assert is_view(read_result(jobs, id_), numbers[id_])
    assert {job.state for job in ended.values()} <= FINAL
    assert not jobs.queue.active.items()
    lock.close()
    consumer.stop(0)
    service.close()
    return Counter(expected.values())


def test_no_power_cut_loses_a_job(tmp_path, memory):
    cuts = power_cuts.list_cuts(power_cuts.record(tmp_path, "-c", RUN, str(tmp_path / "disk"), "1"))
    known = Counter()
    with open_pool(1) as work:
        for number, cut in enumerate(cuts):
            folder = memory / str(number)
            folder.mkdir()
            known |= check(cut, folder, work)
            shutil.rmtree(folder)
    assert len(cuts) > 100
    assert (known["accepted"], known["done"], known["cancelled"]) == (3, 4, 1), known
