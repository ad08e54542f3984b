"""Worker processes that run real tasks."""

import io
import json
import logging
import os
import pickle
import signal
import threading
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ciir.errors import Cancelled, TimedOut, WorkerDied
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.formats import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.jobs.job import INTERNAL_ERROR, Problem, Request, Result
from ciir.service.jobs.workers import consumer
from ciir.service.jobs.workers import pool as module
from ciir.service.jobs.workers import worker as worker_module
from ciir.service.jobs.workers.pool import Pool
from ciir.service.jobs.workers.task import Hooks, Task
from ciir.service.pipeline import run as pipeline
from ciir.service.pipeline.options import Options
from ciir.service.settings import Settings
from tests.support.inputs import CUBE
from tests.support.jobs import submit_data, wait_for_end
from tests.support.paths import ROOT
from tests.support.servers import find_workers, run_python
from tests.support.waiting import wait_until

COLD = "tests.support.workers.cold_worker"
FAST = {"lenses": "12x10", "pixels": "3x3", "model": "none", "backend": "raytrace"}
LONG = {"lenses": "400x400", "pixels": "15x15", "views": "all", "model": "none", "backend": "raytrace"}
"""Takes about ten seconds, so that a test can act meanwhile."""


@pytest.fixture
def open_pool(monkeypatch):
    """Opens pools of one worker without warm-up, closed at the end."""
    monkeypatch.setattr(worker_module, "MODULE", COLD)
    pools = []

    def make(**settings):
        pools.append(Pool(Settings(**{"workers": 1} | settings)))
        return pools[-1]

    yield make
    for pool in pools:
        pool.close()
    assert find_workers(os.getpid(), COLD) == []


def test_small_jobs_do_not_wait_for_jobs_that_were_taken_for_small(open_pool, service, monkeypatch, caplog):
    """Two small files whose views have 16 million pixels, which only their content shows, and one that is small."""
    monkeypatch.setattr(consumer, "SMALL_SECONDS", 1.0)
    jobs = service.open_jobs()
    options = {"pixels": "2x2", "model": "paper", "skip": "none"}
    with caplog.at_level(logging.INFO, logger="ciir.jobs"):
        ids = [
            submit_data(jobs, encode_png(np.full((side, side, 3), grey, np.uint8)), **options).id
            for grey, side in ((1, 4000), (2, 4000), (3, 40))
        ]
        assert {jobs.get(id_).lane for id_ in ids} == {"small"}
        service.start_consumer(jobs, open_pool(workers=2), 2)
        assert wait_for_end(jobs, ids[2]).state == "done"
    assert sorted((jobs.get(id_).lane, jobs.get(id_).attempts >= 1) for id_ in ids[:2]) == [
        ("large", True),
        ("small", True),
    ]
    assert {jobs.get(id_).state for id_ in ids[:2]} <= {"queued", "running"}
    assert "moved to the large lane" in caplog.text
    service.close()


@pytest.fixture
def make_task(tmp_path):
    (tmp_path / "input").write_bytes(CUBE)

    def make(options, form=None, name="upload.off"):
        folder = tmp_path / f"run {len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        return Task("an id", Request(name, options, form), tmp_path / "input", folder / "result")

    return make


def run(pool, task, progress=lambda _: None, cancelled=None, begun=lambda _: None):
    return pool.run(task, Hooks(begun, progress, cancelled or threading.Event()))


def get_worker_pid():
    (pid,) = find_workers(os.getpid(), COLD)
    return pid


class Running:
    """A task that a thread runs; the constructor returns once it has finished views."""

    def __init__(self, pool, task):
        self.cancelled, self.progress, self.outcome = threading.Event(), [], None
        self.thread = threading.Thread(target=self._run, args=(pool, task))
        self.thread.start()
        wait_until(lambda: self.progress and self.progress[-1]["views_done"])

    def _run(self, pool, task):
        try:
            self.outcome = run(pool, task, self.progress.append, self.cancelled)
        except (Cancelled, WorkerDied) as reason:
            self.outcome = reason

    def wait(self):
        self.thread.join(60)
        assert not self.thread.is_alive()
        return self.outcome


def test_a_task_gives_the_pipelines_result_and_progress(open_pool, make_task):
    options = FAST | {"views": "all"}
    progress = []
    task = make_task(options, "zip")
    outcome = run(open_pool(), task, progress.append)
    file = io.BytesIO()
    with FileWriter(file, "zip") as writer:
        report = pipeline.reconstruct(Bundle.from_upload("upload.off", CUBE), Options.parse(options), writer)
    assert read_pictures(file) == read_pictures(task.target)
    assert isinstance(outcome, Result)
    assert (outcome.format, outcome.size) == ("zip", task.target.stat().st_size)
    del report["views"]
    assert outcome.report | {"timings_ms": None} == json.loads(json.dumps(report)) | {"timings_ms": None}
    assert set(outcome.report["timings_ms"]) == set(report["timings_ms"])
    assert progress[0] == {"stage": "decode", "views_done": 0, "views": 0}
    assert [data["stage"] for data in progress][:3] == ["decode", "plan", "render"]
    assert progress[-1] == {"stage": "encode", "views_done": 9, "views": 9}


def read_pictures(file):
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name.endswith(".png")}


@pytest.mark.parametrize(
    ("options", "status", "words"),
    [
        (FAST | {"views": "9,9"}, 422, "views: 9,9 is not there"),
        (FAST | {"views": "all", "pixels": "300x300"}, 413, "over the limit of 65,536"),
        (FAST | {"lenses": "9000x9000"}, 413, "over the limit of 64,000,000"),
    ],
)
def test_an_error_in_a_request_is_a_problem(open_pool, make_task, options, status, words):
    problem = run(open_pool(), make_task(options))
    assert isinstance(problem, Problem)
    assert problem.status == status
    assert words in problem.detail


def test_a_task_over_the_time_limit_is_stopped(open_pool, make_task, monkeypatch):
    monkeypatch.setattr(module, "WORKING_SHARE", 0.0)  # other processes may keep this machine busy
    pool = open_pool(job_seconds=0.5)
    with pytest.raises(TimedOut, match=r"not done after"):
        run(pool, make_task(LONG))
    problem = run(pool, replace(make_task(LONG), has_timed_out=True))
    assert (problem.status, problem.title) == (422, "Takes too long")
    assert "0.5 s" in problem.detail
    pool._seconds = 60
    assert isinstance(run(pool, make_task(FAST)), Result)  # in a new process


def test_a_machine_that_stood_still_fails_no_task(open_pool, make_task):
    pool = open_pool(job_seconds=1.0)
    for has_timed_out in (False, True):
        task = replace(make_task(LONG), has_timed_out=has_timed_out)
        with pytest.raises(WorkerDied, match=r"after 0\.\d s of processor time in 1 s") as died:
            run(pool, task, begun=lambda pid: os.kill(pid, signal.SIGSTOP))
        assert died.type is WorkerDied
    pool._seconds = 60
    assert isinstance(run(pool, make_task(FAST)), Result)  # in a new process


def test_processor_time_is_limited(open_pool, make_task):
    problem = run(open_pool(worker_cpu_seconds=1), make_task(LONG))
    assert (problem.status, problem.title) == (422, "Takes too long")
    assert "1 s of processor time" in problem.detail


def test_a_cancelled_task_is_stopped(open_pool, make_task):
    pool = open_pool()
    running = Running(pool, make_task(LONG))
    before = get_worker_pid()
    running.cancelled.set()
    assert isinstance(running.wait(), Cancelled)
    assert not Path(f"/proc/{before}").exists()
    assert isinstance(run(pool, make_task(FAST)), Result)
    cancelled = threading.Event()
    cancelled.set()
    with pytest.raises(Cancelled):
        run(pool, make_task(FAST), cancelled=cancelled)


def test_a_worker_that_is_killed_during_a_task(open_pool, make_task):
    pool = open_pool()
    running = Running(pool, make_task(LONG))
    os.kill(get_worker_pid(), signal.SIGKILL)
    died = running.wait()
    assert isinstance(died, WorkerDied)
    assert str(died) == "was ended by signal 9 (Killed)"
    assert isinstance(run(pool, make_task(FAST)), Result)


def test_a_worker_that_is_killed_while_idle_fails_no_task(open_pool, make_task):
    pool = open_pool()
    assert isinstance(run(pool, make_task(FAST)), Result)
    before = get_worker_pid()
    os.kill(before, signal.SIGKILL)
    assert isinstance(run(pool, make_task(FAST)), Result)
    wait_until(lambda: pool.is_ready() and get_worker_pid() != before)


def test_the_death_of_a_worker_does_not_affect_another(open_pool, make_task):
    pool = open_pool(workers=2)
    one, other = Running(pool, make_task(LONG)), Running(pool, make_task(LONG))
    one.cancelled.set()
    assert isinstance(one.wait(), Cancelled)
    count = len(other.progress)
    wait_until(lambda: len(other.progress) > count)
    other.cancelled.set()
    assert isinstance(other.wait(), Cancelled)


def test_a_worker_is_replaced_after_some_tasks(open_pool, make_task):
    pool = open_pool(worker_jobs=2)
    pids = []
    for _ in range(4):
        assert isinstance(run(pool, make_task(FAST), begun=pids.append), Result)
    distinct = list(dict.fromkeys(pids))
    assert len(distinct) == 2


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
    with pytest.raises(OSError, match="No space left"):
        run(open_pool(), task)


def test_an_internal_error_is_a_problem_and_logged(open_pool, make_task, monkeypatch, caplog):
    monkeypatch.setenv("PYTHON_FAIL", "1")
    pool = open_pool()
    assert run(pool, make_task(FAST)) == INTERNAL_ERROR
    assert "| RuntimeError: as the test wants" in caplog.text
    assert pool.is_ready()


class Touch:
    """Creates a file where it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@pytest.mark.parametrize("form", ["pickle", "flood", "ready"])
def test_a_worker_that_sends_what_is_no_answer_is_replaced(open_pool, make_task, monkeypatch, tmp_path, form):
    touched = tmp_path / "touched"
    data = {
        "pickle": pickle.dumps(Touch(touched)) + b"\n",
        "flood": b"x" * 60_000,
        "ready": b'{"kind": "ready", "missing": []}\n',
    }[form]
    monkeypatch.setattr(worker_module, "LIMIT", 50_000)
    monkeypatch.setenv("PYTHON_SEND", data.hex())
    pool = open_pool()
    with pytest.raises(WorkerDied):
        run(pool, make_task(FAST))
    assert not touched.exists()
    monkeypatch.delenv("PYTHON_SEND")
    for pid in find_workers(os.getpid(), COLD):  # the next one may have started before
        os.kill(pid, signal.SIGKILL)
    assert isinstance(run(pool, make_task(FAST)), Result)


def test_a_worker_fills_no_log_and_forges_no_line(open_pool, monkeypatch, caplog):
    monkeypatch.setenv("PYTHON_WRITE", "5000")
    wait_until(open_pool().is_ready)
    wait_until(lambda: "its further lines are left out" in caplog.text)
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) == worker_module.LOG_LINES + 1
    assert all(line.startswith("worker process ") and line.isprintable() and len(line) < 2000 for line in lines)


def test_a_missing_input_is_an_error_of_the_parent(open_pool, make_task):
    task = make_task(FAST)
    task.source.unlink()
    with pytest.raises(FileNotFoundError):
        run(open_pool(), task)


def test_a_worker_that_cannot_start_is_reported_and_tried_again(open_pool, monkeypatch, caplog):
    monkeypatch.setattr(worker_module, "MODULE", "missing_module")
    pool = open_pool()
    assert not pool.is_ready()
    wait_until(lambda: pool.start_error)
    assert pool.start_error == "a worker process can't be started (WorkerExitedError); the log says why"
    assert "a worker process can't be started: it has ended (ended with status 1): " in caplog.text
    assert "No module named missing_module" in caplog.text
    wait_until(lambda: caplog.text.count("the next attempt is in") > 1)
    assert "Traceback" not in caplog.text  # it shows nothing of a process that ended
    monkeypatch.setattr(worker_module, "MODULE", COLD)
    wait_until(pool.is_ready)
    assert pool.start_error == ""


def test_the_traceback_of_a_worker_that_cannot_start_is_logged_once(open_pool, monkeypatch, caplog):
    monkeypatch.setenv("PYTHON_WRITE", "no number")
    open_pool(workers=2).start()
    wait_until(lambda: caplog.text.count("the next attempt is in") > 3)
    assert caplog.text.count("Traceback") == 1
    assert caplog.text.count("with base 10: 'no number'; the next attempt") > 3  # the cause is logged each time


def test_a_worker_that_does_not_get_ready_is_ended(open_pool, monkeypatch, caplog):
    monkeypatch.setattr(module, "START_SECONDS", 1.0)
    monkeypatch.setenv("PYTHON_SLEEP", "1000")
    pool = open_pool()
    assert not pool.is_ready()
    wait_until(lambda: pool.start_error)
    assert "it was not ready after 1 s: it sleeps" in caplog.text
    assert "worker process" in caplog.text


def test_missing_restrictions_are_logged(open_pool, monkeypatch, caplog):
    monkeypatch.setenv("PYTHON_MISSING", "the network")
    wait_until(open_pool().is_ready)
    assert "not fully restricted: the network" in caplog.text


def test_files_among_the_libraries_are_logged(open_pool, monkeypatch, caplog, tmp_path):
    exposed = tmp_path / "libraries" / "keys"
    monkeypatch.setenv("LD_LIBRARY_PATH", f":.:/:{tmp_path / 'libraries'}")
    wait_until(open_pool(api_keys_file=exposed, folder=tmp_path / "folder").is_ready)
    (line,) = [record.getMessage() for record in caplog.records if "not fully restricted" in record.getMessage()]
    assert f"it can read CIIR_API_KEYS_FILE ({exposed}), which lies beneath {tmp_path / 'libraries'}; move" in line


def test_close_cancels_tasks(open_pool, make_task):
    pool = open_pool()
    running = Running(pool, make_task(LONG))
    pool.close()
    assert isinstance(running.wait(), Cancelled)
    assert not pool.is_ready()
    with pytest.raises(Cancelled):
        run(pool, make_task(FAST))


def test_the_system_clock_may_be_set(open_pool, make_task, monkeypatch):
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + 1e6)
    pool = open_pool()
    assert isinstance(run(pool, make_task(FAST)), Result)
    monkeypatch.setattr(time, "time", lambda: now() - 1e6)
    assert isinstance(run(pool, make_task(FAST)), Result)


def test_a_ready_worker_has_loaded_the_models():
    pool = Pool(Settings(workers=1))
    try:
        assert not pool.is_ready()
        wait_until(pool.is_ready)
        (pid,) = (worker.pid for worker in pool._ready)
        maps = Path(f"/proc/{pid}/maps").read_text()
    finally:
        pool.close()
    assert "onnxruntime" in maps
    assert "embree" in maps


def test_the_parent_process_does_not_import_what_tasks_need():
    heavy = {"onnxruntime", "embreex", "pyrender", "OpenGL", "PIL", "imagecodecs", "trimesh", "ciir.models.session"}
    code = f"import sys, ciir.service.jobs.workers.pool; print(sorted({heavy} & set(sys.modules)))"
    assert run_python("-c", code, cwd=ROOT).stdout.strip() == "[]"
