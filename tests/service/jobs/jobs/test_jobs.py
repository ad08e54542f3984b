import asyncio
import errno
import io
import math
import os
import shutil
from dataclasses import replace

import pytest

from ciir.errors import InvalidOption, NoRoom, QueueFull, ResultExpired
from ciir.service.jobs import jobs as module
from ciir.service.jobs.job import Event, Problem, Request
from ciir.service.jobs.resource import DISK_FULL
from ciir.service.settings import Settings
from tests.support.jobs import (
    fail_job,
    finish_job,
    list_files,
    read_result,
    run_in_threads,
    set_clock,
    submit_data,
)


def run_async(coroutine):
    asyncio.run(asyncio.wait_for(coroutine, 30))


def test_a_submitted_job_is_stored_and_queued(jobs):
    job = submit_data(jobs, b"data", lenses="5x5")
    assert (job.state, job.attempts, job.lane, job.events) == ("queued", 0, "small", (Event("queued"),))
    assert jobs.get(job.id) == job
    assert jobs.get("0" * 32) is None
    assert jobs.count_waiting() == 1
    assert jobs.queue.pop(("small",), 0.01) == job.id
    with jobs.files.open("inputs", job.input) as file:
        assert file.read() == b"data"


def test_ages_are_of_the_submission_and_of_the_run(jobs, monkeypatch):
    set_clock(monkeypatch, 1000.0)
    running = submit_data(jobs, b"first")
    set_clock(monkeypatch, 1010.0)
    submit_data(jobs, b"second")
    set_clock(monkeypatch, 1015.0)
    jobs.lifecycle.start(running.id, "c-1")
    set_clock(monkeypatch, 1018.0)
    ages = jobs.measure_ages()
    assert (ages["small", "queued"], ages["small", "running"]) == ([8.0], [3.0])
    assert ages["large", "queued"] == ages["large", "running"] == []


def test_equal_requests_are_one_job(jobs):
    first = submit_data(jobs)
    assert submit_data(jobs) == first
    assert jobs.count_waiting() == 1
    running = jobs.lifecycle.start(first.id, "c-1")
    assert submit_data(jobs) == running
    assert jobs.lifecycle.finish(running, Problem(422, "Title", "detail"))
    assert submit_data(jobs).state == "failed"
    assert submit_data(jobs, b"other").id != first.id
    assert list_files(jobs) == [f"inputs/{submit_data(jobs, b'other').input}"]


def test_simultaneous_equal_requests_are_one_job(jobs):
    submitted = []
    run_in_threads(lambda: submitted.append(submit_data(jobs)), 8)
    assert {job.id for job in submitted} == {submitted[0].id}
    assert jobs.count_waiting() == 1
    assert list_files(jobs) == [f"inputs/{submitted[0].input}"]
    assert list(jobs.queue.active.items()) == [submitted[0].input]


def test_a_job_whose_result_is_gone_is_run_again(jobs):
    job = submit_data(jobs)
    with pytest.raises(ResultExpired, match=f"{job.id}.*post the input again"):
        jobs.open_result(job.id)
    assert finish_job(jobs, job).state == "done"
    assert read_result(jobs, job.id) == b"result"
    assert submit_data(jobs).state == "done"
    assert list_files(jobs) == [f"results/{jobs.get(job.id).output}"]
    assert not jobs.queue.active.items()
    jobs.files.remove("results", jobs.get(job.id).output)
    with pytest.raises(ResultExpired):
        jobs.open_result(job.id)
    again = submit_data(jobs)
    assert (again.state, again.events) == ("queued", (Event("queued"),))
    assert finish_job(jobs, again).state == "done"


@pytest.mark.parametrize("damage", [b"", b"resul", b"Result", b"result and more"])
def test_a_damaged_result_is_made_again(service, jobs, damage, caplog):
    job = finish_job(jobs, submit_data(jobs))
    assert read_result(jobs, job.id) == b"result"
    path = jobs.folder / "files" / "results" / job.output
    times = (path.stat().st_atime, path.stat().st_mtime)
    path.write_bytes(damage)
    os.utime(path, times)
    for each in (jobs, service.open_jobs()):
        with pytest.raises(ResultExpired, match="post the input again"):
            each.open_result(job.id)
    assert f"job {job.id}: removed its result, which is damaged" in caplog.text
    again = submit_data(jobs)
    assert again.state == "queued"
    finish_job(jobs, again)
    assert read_result(jobs, job.id) == b"result"


def test_a_damaged_result_is_noticed_by_the_next_identical_request(jobs):
    job = finish_job(jobs, submit_data(jobs))
    (jobs.folder / "files" / "results" / job.output).write_bytes(b"")
    assert submit_data(jobs).state == "queued"


@pytest.mark.parametrize(("status", "state"), [(422, "failed"), (413, "failed"), (500, "queued"), (503, "queued")])
def test_only_errors_of_the_server_are_tried_again(jobs, status, state):
    job = submit_data(jobs)
    assert fail_job(jobs, job, status).problem == Problem(status, "Title", "detail")
    assert list_files(jobs) == []
    assert submit_data(jobs).state == state


@pytest.mark.parametrize("end", [finish_job, lambda jobs, job: fail_job(jobs, job, 422)])
@pytest.mark.parametrize("maker", ["another version", ""])  # a version from before `made_by` stores none
def test_what_a_worker_of_another_version_made_answers_no_new_request(service, jobs, monkeypatch, end, maker):
    with monkeypatch.context() as patch:
        patch.setattr(module, "hash_installation", lambda: maker)
        old = service.open_jobs()
    job = end(old, submit_data(jobs))
    again = submit_data(jobs)
    assert (again.id, again.state, again.made_by) == (job.id, "queued", "")
    assert list_files(jobs) == [f"inputs/{again.input}"]
    ended = end(jobs, again)
    assert submit_data(jobs) == ended


def test_a_cancelled_job_may_be_submitted_again(jobs):
    assert jobs.cancel("0" * 32) is None
    job = submit_data(jobs)
    cancelled = jobs.cancel(job.id)
    assert (cancelled.state, cancelled.events[-1]) == ("cancelled", Event("cancelled"))
    assert list_files(jobs) == []
    assert jobs.lifecycle.start(job.id, "c-1") is None
    again = submit_data(jobs)
    assert again.state == "queued"
    assert finish_job(jobs, again).state == "done"


@pytest.mark.parametrize("end", ["cancelled", "failed", "done"])
def test_a_job_that_has_ended_is_removed(jobs, end):
    job = submit_data(jobs)
    if end == "cancelled":
        ended = jobs.cancel(job.id)
    else:
        ended = finish_job(jobs, job) if end == "done" else fail_job(jobs, job, 422)
    assert jobs.cancel(job.id) == ended
    assert jobs.get(job.id) is None
    assert (list_files(jobs), jobs.queue.finished.items(), jobs.queue.jobs.items()) == ([], {}, {})
    assert submit_data(jobs).state == "queued"


def test_a_job_of_several_clients_is_cancelled_by_the_last(jobs):
    job = submit_data(jobs, client="a")
    assert submit_data(jobs, client="b").clients == ("a", "b")
    run = jobs.lifecycle.start(job.id, "c-1")
    assert submit_data(jobs, client="c") == jobs.get(job.id)
    assert jobs.cancel(job.id, "d").clients == ("a", "b", "c")  # it never asked
    assert [jobs.cancel(job.id, client).state for client in ("a", "a", "b")] == ["running"] * 3
    assert jobs.lifecycle.add_progress(run, {"stage": "map"})
    assert jobs.cancel(job.id, "c").state == "cancelled"
    assert list_files(jobs) == []
    assert submit_data(jobs, client="b").clients == ("b",)


def test_a_result_that_another_asks_for_meanwhile_is_kept(jobs, monkeypatch):
    job = finish_job(jobs, submit_data(jobs, client="a"))
    expire = jobs._expire

    def join_first(*given):
        submit_data(jobs, client="b")
        expire(*given)

    monkeypatch.setattr(jobs, "_expire", join_first)
    jobs.cancel(job.id, "a")
    monkeypatch.undo()
    assert jobs.stores_result(jobs.get(job.id))


def test_anyone_removes_a_cancelled_job(jobs):
    job = submit_data(jobs, client="a")
    assert jobs.cancel(job.id, "a").clients == ()
    assert jobs.cancel(job.id, "b").state == "cancelled"
    assert jobs.get(job.id) is None


def test_a_job_without_clients_is_cancelled_by_any(jobs):
    job = submit_data(jobs, client="a")
    jobs.records.update(job.id, lambda job: replace(job, clients=()))  # as an older version stored it
    assert jobs.cancel(job.id, "b").state == "cancelled"


def test_the_result_of_several_clients_is_removed_by_the_last(jobs):
    job = finish_job(jobs, submit_data(jobs, client="a"))
    assert submit_data(jobs, client="b").clients == ("a", "b")
    assert jobs.cancel(job.id, "a").state == "done"
    assert read_result(jobs, job.id) == b"result"
    assert jobs.cancel(job.id, "b").state == "done"
    assert (jobs.get(job.id), list_files(jobs)) == (None, [])


def test_a_full_queue(service):
    jobs = service.open_jobs(max_waiting=2)
    queued = [submit_data(jobs, bytes([number])) for number in range(2)]
    with pytest.raises(QueueFull) as raised:
        submit_data(jobs, b"2")
    assert 1 <= raised.value.retry_after <= 2
    assert str(raised.value).startswith("the queue is full: 2 jobs wait, and the limit is 2; try again in ")
    assert submit_data(jobs, bytes([1])) == queued[1]
    assert submit_data(jobs, b"2", views="all").lane == "large"  # the other lane is not full
    assert len(list_files(jobs)) == 3
    jobs.queue.pop(("small",), 0.01)
    assert submit_data(jobs, b"2").state == "queued"


def test_a_full_queue_of_large_jobs_has_no_place_before_one_has_ended(service, monkeypatch):
    jobs = service.open_jobs(max_waiting=1, job_seconds=300)
    large = {"views": "all", "lenses": "150x150", "model": "field-quality"}
    submit_data(jobs, **large)
    with pytest.raises(QueueFull) as raised:
        submit_data(jobs, b"2", **large)
    assert 20 < raised.value.retry_after < 300
    monkeypatch.setattr("ciir.service.jobs.jobs.estimate_job", lambda *_: math.inf)
    with pytest.raises(QueueFull) as raised:
        submit_data(jobs, b"2", **large)
    assert raised.value.retry_after == 300


def test_a_full_disk(jobs, monkeypatch):
    def fill_disk(file, out, length):
        out.write(file.read(2))
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfileobj", fill_disk)
        with pytest.raises(NoRoom, match=DISK_FULL):
            submit_data(jobs)
    assert list_files(jobs) == []
    assert (jobs.count_waiting(), jobs.queue.active.items(), jobs.queue.jobs.items()) == (0, {}, {})
    assert submit_data(jobs).state == "queued"


def test_a_folder_that_cannot_be_created(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InvalidOption, match="name another"):
        module.Jobs(Settings(folder=tmp_path / "file" / "below"))


def test_waiting_for_changes(jobs):
    job = submit_data(jobs)

    async def follow():
        assert await jobs.watcher.wait_for_change(job.id, 0) == job
        waiting = asyncio.create_task(jobs.watcher.wait_for_change(job.id, 1))
        run = await asyncio.to_thread(jobs.lifecycle.start, job.id, "c-1")
        assert await waiting == run
        waiting = asyncio.create_task(jobs.watcher.wait_for_change(job.id, 2))
        await asyncio.to_thread(jobs.lifecycle.add_progress, run, {"stage": "map"})
        assert (await waiting).events[-1] == Event("progress", {"stage": "map"})
        ended = await asyncio.to_thread(jobs.cancel, job.id)
        assert await jobs.watcher.wait_for_change(job.id, 4) == ended  # without waiting
        with pytest.raises(LookupError):
            await jobs.watcher.wait_for_change("0" * 32, 0)

    run_async(follow())


def test_waiting_for_a_change_in_another_process(service, jobs):
    other = service.open_jobs()  # its changes don't notify `jobs`
    job = submit_data(jobs)

    async def follow():
        waiting = asyncio.create_task(jobs.watcher.wait_for_change(job.id, 1))
        await asyncio.sleep(0)
        run = await asyncio.to_thread(other.lifecycle.start, job.id, "c-1")
        assert await waiting == run

    run_async(follow())


def test_waiting_ends_when_the_job_is_removed(jobs):
    job = submit_data(jobs)

    async def follow():
        waiting = asyncio.create_task(jobs.watcher.wait_for_change(job.id, 1))
        await asyncio.sleep(0)
        await asyncio.to_thread(jobs.records.remove, job.id, lambda job: True)
        with pytest.raises(LookupError):
            await waiting

    run_async(follow())


def test_the_servers_limits_are_part_of_the_id(service, jobs):
    request = Request("upload.png", {}, None)
    other = service.open_jobs(max_output_pixels=5)
    assert jobs.submit(request, io.BytesIO(b"x"))[0].id != other.submit(request, io.BytesIO(b"x"))[0].id
