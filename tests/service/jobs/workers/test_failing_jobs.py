"""What a consumer does where a job can't be run."""

import errno
import logging
import os
from pathlib import Path

import pytest

from ciir.errors import WorkerDied
from ciir.service.jobs.job import INTERNAL_ERROR, NO_ROOM, Problem
from ciir.service.jobs.workers import recovery
from tests.support.jobs import list_files, raise_worker_died, read_result, submit_data, wait_for_end, write_double
from tests.support.waiting import wait_until


@pytest.mark.parametrize("problem", [Problem(422, "Not readable", "no file"), Problem(503, "No room", "full")])
def test_a_problem_fails_the_job(service, jobs, pool, problem):
    def write_part(task, progress, cancelled):
        task.target.write_bytes(b"a part")
        return problem

    pool.work = write_part
    service.start_consumer(jobs, pool)
    job = wait_for_end(jobs, submit_data(jobs).id)
    assert (job.state, job.problem) == ("failed", problem)
    wait_until(lambda: list_files(jobs) == [])


def test_an_unexpected_exception_fails_the_job_and_is_logged(service, jobs, pool, caplog):
    pool.work = lambda task, progress, cancelled: 1 // 0
    service.start_consumer(jobs, pool)
    with caplog.at_level(logging.ERROR):
        job = wait_for_end(jobs, submit_data(jobs).id)
    assert job.problem == INTERNAL_ERROR
    assert "ZeroDivisionError" in caplog.text
    pool.work = write_double
    assert wait_for_end(jobs, submit_data(jobs).id, {"done"}).attempts == 1


@pytest.mark.usefixtures("retries_at_once")
def test_an_outcome_that_cannot_be_stored_ends_no_thread(service, jobs, pool, monkeypatch, caplog):
    monkeypatch.setattr(recovery, "LOST_SECONDS", 0.0)
    pool.work = lambda task, progress, cancelled: Problem(422, "Title", float("nan"))  # not valid JSON
    service.start_consumer(jobs, pool)
    job = submit_data(jobs)
    with caplog.at_level(logging.ERROR):
        wait_until(lambda: "ValueError" in caplog.text)
    pool.work = write_double
    assert wait_for_end(jobs, job.id).state == "done"


def test_a_disk_that_is_full_when_the_result_is_published(service, jobs, pool, monkeypatch):
    move = Path.replace

    def fail_for_results(path, target):
        if "/results/" in str(target):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return move(path, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail_for_results)
        service.start_consumer(jobs, pool)
        job = wait_for_end(jobs, submit_data(jobs).id)
    assert (job.state, job.problem) == ("failed", NO_ROOM)
    wait_until(lambda: list_files(jobs) == [])
    assert wait_for_end(jobs, submit_data(jobs).id, {"done"}).attempts == 1


def test_a_job_whose_worker_dies_once_is_run_again(service, jobs, pool):
    def die_once(task, progress, cancelled):
        task.target.write_bytes(b"half")
        work = raise_worker_died if len(pool.started) == 1 else write_double
        return work(task, progress, cancelled)

    pool.work = die_once
    service.start_consumer(jobs, pool)
    job = wait_for_end(jobs, submit_data(jobs).id)
    assert (job.state, job.attempts, job.worker_deaths) == ("done", 2, 1)
    assert [event.kind for event in job.events] == ["queued", "running", "queued", "running", "done"]
    assert read_result(jobs, job.id) == b"datadata"


def test_a_cause_that_is_known_is_reported(service, jobs, pool):
    def run_out_of_time(task, progress, cancelled):
        raise WorkerDied("was not done", "it was not done after 8 s")

    pool.work = run_out_of_time
    service.start_consumer(jobs, pool)
    job = wait_for_end(jobs, submit_data(jobs).id)
    assert (job.problem.status, len(pool.started)) == (503, 2)
    assert "in the last one because it was not done after 8 s; submit again later" in job.problem.detail


@pytest.mark.parametrize("damage", [b"", b"bb", None])
def test_a_damaged_input_fails_the_job_until_it_is_sent_again(service, jobs, pool, damage):
    job = submit_data(jobs, b"ab")
    path = jobs.folder / "files" / "inputs" / job.input
    path.unlink()
    if damage is not None:
        path.write_bytes(damage)
    service.start_consumer(jobs, pool)
    failed = wait_for_end(jobs, job.id)
    assert (failed.state, failed.problem.status, pool.started) == ("failed", 503, [])
    assert "post it again" in failed.problem.detail
    assert wait_for_end(jobs, submit_data(jobs, b"ab").id).state == "done"
    assert read_result(jobs, job.id) == b"abab"
