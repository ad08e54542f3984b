"""Limits on the tasks of worker processes: time, memory and bytes."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ciir.errors import TimedOut, WorkerDied
from ciir.renderer.writers.pictures import encode_png
from ciir.service.jobs.job import Problem, Result
from ciir.service.jobs.workers import pool as module
from tests.support.waiting import wait_until
from tests.support.workers.pools import FAST, LONG, run


def test_a_task_over_the_time_limit_is_stopped(open_pool, make_task, monkeypatch):
    monkeypatch.setattr(module, "WORKING_SHARE", 0.0)  # other processes may keep this machine busy
    pool = open_pool(job_seconds=0.5)
    with pytest.raises(TimedOut, match=r"not done after") as timed_out:
        run(pool, make_task(LONG))
    assert timed_out.value.cause == "the job was not done after 0.5 s, the operator's limit (CIIR_JOB_SECONDS)"
    problem = run(pool, replace(make_task(LONG), has_timed_out=True))
    assert (problem.status, problem.title) == (422, "Takes too long")
    assert "0.5 s, twice (CIIR_JOB_SECONDS), the operator's limit;" in problem.detail
    pool._seconds = 60
    assert isinstance(run(pool, make_task(FAST)), Result)  # in a new process


def test_a_machine_that_stood_still_fails_no_task(open_pool, make_task):
    pool = open_pool(job_seconds=1.0)
    for has_timed_out in (False, True):
        task = replace(make_task(LONG), has_timed_out=has_timed_out)
        with pytest.raises(WorkerDied, match=r"after 0\.\d s of processor time in 1 s") as died:
            run(pool, task, begun=lambda pid: os.kill(pid, signal.SIGSTOP))
        assert died.type is WorkerDied
        cause = "the job was not done after 1 s, the operator's limit (CIIR_JOB_SECONDS): the server was overloaded"
        assert died.value.cause == cause
    pool._seconds = 60
    assert isinstance(run(pool, make_task(FAST)), Result)  # in a new process


def test_processor_time_is_limited(open_pool, make_task):
    problem = run(open_pool(worker_cpu_seconds=1), make_task(LONG))
    assert (problem.status, problem.title) == (422, "Takes too long")
    assert "1 s of processor time (CIIR_WORKER_CPU_SECONDS), the operator's limit;" in problem.detail


def test_memory_is_limited(open_pool, make_task, tmp_path, monkeypatch):
    (tmp_path / "input").write_bytes(encode_png(np.zeros((6000, 6000, 4), np.uint8)))  # some 100 KB
    pool = open_pool()
    pool._limits = replace(pool._limits, memory=2**29)  # less than the setting allows: full sooner
    pids = []
    task = make_task({"lenses": "3000x3000", "model": "none"}, name="upload.png")
    problem = run(pool, task, begun=pids.append)
    assert isinstance(problem, Problem)
    assert len(pids) == 1  # in a new process it stands at once
    assert (problem.status, problem.title) == (413, "Over a limit")
    assert "memory" in problem.detail
    assert not pool.is_ready()  # the process is replaced
    wait_until(pool.is_ready)
    monkeypatch.setattr(module.memory, "may_lack", lambda wanted: wanted == 2**29)
    assert run(pool, task).status == 503  # the system may have refused what the limit allows


def test_memory_that_earlier_tasks_took_fails_no_task(open_pool, make_task, tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("PYTHON_KEEP", str(3 * 2**29))
    (tmp_path / "input").write_bytes(encode_png(np.zeros((6000, 6000, 4), np.uint8)))
    pool, pids = open_pool(workers=2), []
    pool._limits = replace(pool._limits, memory=2**31)
    large = make_task({"lenses": "3000x3000", "model": "none"}, name="upload.png")
    small = replace(make_task({"lenses": "30x30", "model": "none"}, name="upload.png"), source=tmp_path / "small")
    small.source.write_bytes(encode_png(np.zeros((60, 60, 3), np.uint8)))
    wait_until(lambda: pool.is_ready() and pool.count_ready() == 2)
    for task in (small, small, large):
        assert isinstance(run(pool, task, begun=pids.append), Result)
    first, second, used, new = pids
    assert first != second
    assert used in (first, second)
    assert new not in (first, second)
    assert "lacked memory after 1 other tasks; a new one runs it" in caplog.text


def test_the_results_size_is_limited(open_pool, make_task):
    options = FAST | {"lenses": "200x200", "pixels": "9x9", "views": "all"}
    problem = run(open_pool(worker_file_bytes=2**20), make_task(options, "npz"))
    assert (problem.status, problem.title) == (413, "Over a limit")
    assert "the result is over 1,048,576 bytes" in problem.detail


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_an_error_of_the_parent(open_pool, make_task):
    task = make_task(FAST)
    task.target.symlink_to("/dev/full")
    pool, pids = open_pool(), []
    with pytest.raises(OSError, match="No space left"):
        run(pool, task, begun=pids.append)
    task.target.unlink()
    assert isinstance(run(pool, task, begun=pids.append), Result)
    assert pids[0] == pids[1]  # it ends no worker
