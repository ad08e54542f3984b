import asyncio
import errno
import io
import os
import shutil
import threading
import time

import pytest

from ciir.errors import InvalidOption, QueueFull, QueueUnavailable, ResultExpired
from ciir.service.jobs import jobs as module
from ciir.service.jobs.job import Event, Problem, Result
from ciir.service.settings import Settings


def done(jobs, job, data=b"result", claim="c-1"):
    """The job, run by hand."""
    run = jobs.lifecycle.begin(job.id, claim)
    with jobs.files.run(run.input, run.output) as place:
        place.target.write_bytes(data)
        place.keep()
    assert jobs.lifecycle.finish(run, Result("png", len(data), {"timings_ms": {}}))
    return jobs.get(job.id)


def failed(jobs, job, status):
    run = jobs.lifecycle.begin(job.id, "c-1")
    assert jobs.lifecycle.finish(run, Problem(status, "Title", "detail"))
    return jobs.get(job.id)


def result(jobs, id_):
    with jobs.open_result(id_) as file:
        return file.read()


def at(monkeypatch, seconds):
    """Sets the clock on the wall."""
    monkeypatch.setattr(time, "time", lambda: seconds)


def test_handed_in(jobs, helpers):
    job = helpers.submit(jobs, b"data", lenses="5x5")
    assert (job.state, job.attempts, job.lane, job.events) == ("queued", 0, "small", (Event("queued"),))
    assert jobs.get(job.id) == job
    assert jobs.get("0" * 32) is None
    assert (jobs.waiting(), jobs.running()) == (1, 0)
    assert jobs.queue.pop(("small",), 0.01) == job.id
    with jobs.files.open("inputs", job.input) as file:
        assert file.read() == b"data"


def test_the_same_again_is_the_same_job(jobs, helpers):
    first = helpers.submit(jobs)
    assert helpers.submit(jobs) == first
    assert jobs.waiting() == 1
    running = jobs.lifecycle.begin(first.id, "c-1")
    assert helpers.submit(jobs) == running
    assert jobs.lifecycle.finish(running, Problem(422, "Title", "detail"))
    assert helpers.submit(jobs).state == "failed"
    assert helpers.submit(jobs, b"other").id != first.id
    assert helpers.all_files(jobs.folder) == [f"files/inputs/{helpers.submit(jobs, b'other').input}"]


def test_many_at_once_are_one_job(jobs, helpers):
    start = threading.Barrier(8)
    made = []

    def hand_in():
        start.wait()
        made.append(helpers.submit(jobs))

    threads = [threading.Thread(target=hand_in) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {job.id for job in made} == {made[0].id}
    assert jobs.waiting() == 1
    assert helpers.all_files(jobs.folder) == [f"files/inputs/{made[0].input}"]
    assert list(jobs.queue.active.items()) == [made[0].input]


def test_a_result_is_there_until_it_is_gone(jobs, helpers):
    job = helpers.submit(jobs)
    with pytest.raises(ResultExpired, match=f"{job.id}.*post the input again"):
        jobs.open_result(job.id)
    assert done(jobs, job).state == "done"
    assert result(jobs, job.id) == b"result"
    assert helpers.submit(jobs).state == "done"
    assert helpers.all_files(jobs.folder) == [f"files/results/{jobs.get(job.id).output}"]
    assert not jobs.queue.active.items()
    jobs.files.remove("results", jobs.get(job.id).output)
    with pytest.raises(ResultExpired):
        jobs.open_result(job.id)
    again = helpers.submit(jobs)
    assert (again.state, again.events) == ("queued", (Event("queued"),))
    assert done(jobs, again).state == "done"


@pytest.mark.parametrize(("status", "state"), [(422, "failed"), (413, "failed"), (500, "queued"), (503, "queued")])
def test_the_inputs_fault_stands_and_the_servers_does_not(jobs, helpers, status, state):
    job = helpers.submit(jobs)
    assert failed(jobs, job, status).problem == Problem(status, "Title", "detail")
    assert helpers.all_files(jobs.folder) == []
    assert helpers.submit(jobs).state == state


def test_cancelled_and_asked_for_again(jobs, helpers):
    assert jobs.cancel("0" * 32) is None
    job = helpers.submit(jobs)
    cancelled = jobs.cancel(job.id)
    assert (cancelled.state, cancelled.events[-1]) == ("cancelled", Event("cancelled"))
    assert helpers.all_files(jobs.folder) == []
    assert jobs.cancel(job.id) == cancelled
    assert jobs.lifecycle.begin(job.id, "c-1") is None
    again = helpers.submit(jobs)
    assert again.state == "queued"
    ended = done(jobs, again)
    assert jobs.cancel(job.id) == ended
    assert result(jobs, job.id) == b"result"


def test_a_full_queue(service, helpers):
    jobs = service.jobs(max_waiting=2)
    held = [helpers.submit(jobs, bytes([number])) for number in range(2)]
    with pytest.raises(QueueFull) as raised:
        helpers.submit(jobs, b"2")
    assert 1 <= raised.value.retry_after <= 2
    assert helpers.submit(jobs, bytes([1])) == held[1]
    assert helpers.submit(jobs, b"2", views="all").lane == "large"  # the other lane has room
    assert len(helpers.all_files(jobs.folder)) == 3
    jobs.queue.pop(("small",), 0.01)
    assert helpers.submit(jobs, b"2").state == "queued"


def test_a_full_disk(jobs, helpers, monkeypatch):
    def full(file, out, length):
        out.write(file.read(2))
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfileobj", full)
        with pytest.raises(QueueUnavailable, match=r"No space left.*make room"):
            helpers.submit(jobs)
    assert helpers.all_files(jobs.folder) == []
    assert (jobs.waiting(), jobs.queue.active.items(), jobs.queue.jobs.items()) == (0, {}, {})
    assert helpers.submit(jobs).state == "queued"


def test_a_folder_that_cannot_be(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InvalidOption, match="name another"):
        module.Jobs(Settings(folder=tmp_path / "file" / "below"))


def test_changes(jobs, helpers):
    job = helpers.submit(jobs)

    async def follow():
        assert await jobs.wait_for_change(job.id, 0) == job
        waiting = asyncio.create_task(jobs.wait_for_change(job.id, 1))
        run = await asyncio.to_thread(jobs.lifecycle.begin, job.id, "c-1")
        assert await waiting == run
        waiting = asyncio.create_task(jobs.wait_for_change(job.id, 2))
        await asyncio.to_thread(jobs.lifecycle.progress, run, {"stage": "map"})
        assert (await waiting).events[-1] == Event("progress", {"stage": "map"})
        ended = await asyncio.to_thread(jobs.cancel, job.id)
        assert await jobs.wait_for_change(job.id, 4) == ended  # nothing more can come
        with pytest.raises(LookupError):
            await jobs.wait_for_change("0" * 32, 0)

    asyncio.run(asyncio.wait_for(follow(), 30))


def test_changes_of_another_process(service, jobs, helpers):
    other = service.jobs()  # what it changes isn't told here, so that only looking helps
    job = helpers.submit(jobs)

    async def follow():
        waiting = asyncio.create_task(jobs.wait_for_change(job.id, 1))
        await asyncio.sleep(0)
        run = await asyncio.to_thread(other.lifecycle.begin, job.id, "c-1")
        assert await waiting == run

    asyncio.run(asyncio.wait_for(follow(), 30))


def test_whoever_waits_for_a_job_that_is_forgotten_hears_of_it(service, jobs, helpers, monkeypatch):
    job = helpers.submit(jobs)

    async def follow():
        waiting = asyncio.create_task(jobs.wait_for_change(job.id, 1))
        await asyncio.sleep(0)
        await asyncio.to_thread(jobs.records.remove, job.id, lambda job: True)
        with pytest.raises(LookupError):
            await waiting

    asyncio.run(asyncio.wait_for(follow(), 30))


def test_the_longest_unused_go_first(service, helpers, monkeypatch):
    jobs = service.jobs(keep_bytes=5000)
    ids = []
    for number in range(4):
        at(monkeypatch, 1000.0 + number)
        ids.append(done(jobs, helpers.submit(jobs, bytes([number])), bytes(1500)).id)
    at(monkeypatch, 1010.0)
    result(jobs, ids[0])
    jobs.sweep()
    assert all(jobs.get(id_) for id_ in ids)  # whoever asked just now gets it, however little room there is
    at(monkeypatch, 1010.0 + module.LEAST_SECONDS)
    jobs.sweep()
    assert [jobs.get(id_) is not None for id_ in ids] == [True, False, False, True]
    assert len(helpers.all_files(jobs.folder)) == len(jobs.queue.kept.items()) == 2
    jobs.sweep()
    assert len(jobs.queue.kept.items()) == 2


def test_however_small_there_are_only_so_many(service, helpers, monkeypatch):
    monkeypatch.setattr(module, "MOST_KEPT", 3)
    jobs = service.jobs()
    at(monkeypatch, 1000.0)
    ids = [failed(jobs, helpers.submit(jobs, bytes([number])), 422).id for number in range(4)]
    at(monkeypatch, 1001.0 + module.LEAST_SECONDS)
    helpers.submit(jobs, bytes([0]))
    jobs.sweep()
    assert [jobs.get(id_) is not None for id_ in ids].count(True) == 3
    assert jobs.get(ids[0]) is not None


def test_old_ones_go(service, helpers, monkeypatch):
    jobs = service.jobs(keep_seconds=100)
    at(monkeypatch, 1000.0)
    old, used, bad = (helpers.submit(jobs, data) for data in (b"old", b"used", b"bad"))
    for job in (old, used):
        done(jobs, job)
    failed(jobs, bad, 422)
    at(monkeypatch, 1090.0)
    helpers.submit(jobs, b"used")
    waiting = helpers.submit(jobs, b"waiting")
    at(monkeypatch, 1101.0)
    jobs.sweep()
    assert [jobs.get(job.id) is not None for job in (old, used, bad, waiting)] == [False, True, False, True]
    at(monkeypatch, 9999.0)
    jobs.sweep()
    assert jobs.get(waiting.id) == waiting  # what waits or runs is never too old
    assert helpers.all_files(jobs.folder) == [f"files/inputs/{waiting.input}"]


def test_a_clock_that_is_set_back_harms_nothing(service, helpers, monkeypatch):
    jobs = service.jobs(keep_seconds=100)
    at(monkeypatch, 10_000.0)
    before = done(jobs, helpers.submit(jobs, b"before"))
    waiting = helpers.submit(jobs, b"waiting")
    at(monkeypatch, 50.0)
    jobs.sweep()
    after = done(jobs, helpers.submit(jobs, b"after"))
    assert result(jobs, after.id) == b"result"
    assert done(jobs, waiting).state == "done"
    at(monkeypatch, 140.0)
    jobs.sweep()
    assert jobs.get(before.id) is not None
    at(monkeypatch, 151.0)  # its age counts from when the clock was set back
    jobs.sweep()
    assert jobs.get(before.id) is None
    assert jobs.get(after.id) is None


def test_what_is_forgotten_while_it_is_asked_for_again_is_made_again(service, helpers, monkeypatch):
    jobs = service.jobs(keep_seconds=100)
    at(monkeypatch, 1000.0)
    job = failed(jobs, helpers.submit(jobs), 503)
    again = helpers.submit(jobs)
    at(monkeypatch, 2000.0)
    jobs.sweep()  # the failed run is too old; the one that waits is not touched
    assert jobs.get(job.id) == again
    assert result(jobs, done(jobs, again, claim="c-2").id) == b"result"


def test_jobs_outlive_the_process(service, jobs, helpers):
    ended, waiting = done(jobs, helpers.submit(jobs, b"a")), helpers.submit(jobs, b"b")
    jobs.close()
    again = service.jobs()
    assert again.get(waiting.id) == waiting
    assert result(again, ended.id) == b"result"
    assert waiting.id in again.queue.contents()


def test_the_limits_in_force_are_part_of_a_jobs_id(service, jobs):
    request = module.Request("upload.png", {}, None)
    other = service.jobs(max_output_pixels=5)
    assert jobs.submit(request, io.BytesIO(b"x"), size=1).id != other.submit(request, io.BytesIO(b"x"), size=1).id
