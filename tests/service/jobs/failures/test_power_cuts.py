"""After a power cut at any moment no accepted job is lost, and no job that is done lacks its result."""

import shutil
import tempfile
from collections import Counter
from pathlib import Path

import pytest

from ciir.service.jobs.job import FINAL
from ciir.service.jobs.lanes import LANES
from ciir.service.jobs.workers.consumer import Consumer
from ciir.service.jobs.workers.consumer_lock import ConsumerLock
from ciir.service.jobs.workers.recovery import STALE_SECONDS, Recovery
from tests.service.jobs.failures import power_cuts
from tests.support.jobs import JobService, StandInPool, read_result

RUN = """
import io, sys, threading
from pathlib import Path
from ciir.service.jobs.job import Request
from tests.support.jobs import JobService, StandInPool, submit_data, wait_for_end, write_double
from tests.service.jobs.failures.power_cuts import mark
from tests.support.waiting import wait_until

def submit(number):
    data = (b"%d," % number) * 5000
    mark("any", jobs.compute_id(Request("upload.png", {}, None), io.BytesIO(data)), data.decode())
    job = submit_data(jobs, data)
    mark("accepted", job.id, data.decode())
    return job

def finish(job):
    assert wait_for_end(jobs, job.id).state == "done"
    mark("done", job.id)

def work(*args):
    gate.wait()
    return write_double(*args)

service = JobService(Path(sys.argv[1], "service"))
jobs, gate = service.open_jobs(), threading.Event()
gate.set()
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


@pytest.fixture
def memory():
    """A folder in memory, where syncing takes no time."""
    shared = Path("/dev/shm")  # noqa: S108 - a folder of its own is made there
    with tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None) as folder:
        yield Path(folder)


def check(cut, folder):
    """Starts the service on what a power cut left; returns what clients knew of how many jobs."""
    cut.write(folder)
    expected = {id_: state for state, id_, *_ in map(str.split, cut.marks)}
    results = {id_: 2 * data[0].encode() for _, id_, *data in map(str.split, cut.marks) if data}
    service = JobService(folder / "service")
    jobs, pool, now = service.open_jobs(), StandInPool(), [0.0]
    for job in (jobs.get(id_) for id_, state in expected.items() if state == "done"):
        assert job.state == "done"
        assert read_result(jobs, job.id) == results[job.id]
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
            assert read_result(jobs, id_) == results[id_]
    assert {job.state for job in ended.values()} <= FINAL
    assert not jobs.queue.active.items()
    lock.close()
    consumer.stop(0)
    service.close()
    return Counter(expected.values())


def test_no_power_cut_loses_a_job(tmp_path, memory):
    cuts = power_cuts.list_cuts(power_cuts.record(tmp_path, "-c", RUN, str(tmp_path / "disk"), "1"))
    known = Counter()
    for number, cut in enumerate(cuts):
        folder = memory / str(number)
        folder.mkdir()
        known |= check(cut, folder)
        shutil.rmtree(folder)
    assert len(cuts) > 100
    assert (known["accepted"], known["done"], known["cancelled"]) == (3, 4, 1), known
