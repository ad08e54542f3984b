"""Worker processes that run real tasks."""

import io
import json
import logging
import os
import pickle
import shutil
import signal
import threading
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ciir.errors import Cancelled, WorkerDied
from ciir.models import cards
from ciir.models.catalogue import SHIPPED
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.jobs import lanes
from ciir.service.jobs.job import INTERNAL_ERROR, Problem, Result
from ciir.service.jobs.workers import consumer
from ciir.service.jobs.workers import worker as worker_module
from ciir.service.pipeline import run as pipeline
from ciir.service.pipeline.options import Options
from tests.support.inputs import CUBE_OBJ
from tests.support.jobs import submit_data, wait_for_end
from tests.support.paths import ROOT
from tests.support.servers import find_workers, run_python
from tests.support.waiting import wait_until
from tests.support.workers.pools import COLD, FAST, LONG, run


def test_small_jobs_do_not_wait_for_jobs_that_were_taken_for_small(open_pool, service, monkeypatch, caplog):
    """Two small files whose views have 16 million pixels, as if only time showed that, and one that is small."""
    monkeypatch.setattr(consumer, "SMALL_SECONDS", 1.0)
    monkeypatch.setattr(lanes, "measure", lambda file: lanes.Content(1000))
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
        report = pipeline.reconstruct(Bundle.from_upload("upload.obj", CUBE_OBJ), Options.parse(options), writer)
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


def test_a_worker_may_read_networks_of_ones_own(open_pool, make_task, monkeypatch, tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    shutil.copy(SHIPPED / "fast.onnx", folder / "mine.onnx")
    cards.write_card(replace(cards.read_card(SHIPPED / "fast.json"), name="mine"), folder / "mine.json")
    monkeypatch.setenv("CIIR_MODELS", str(folder))
    outcome = run(open_pool(), make_task(FAST | {"model": "mine"}))
    assert isinstance(outcome, Result), outcome
    assert outcome.report["model"]["name"] == "mine"


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


@pytest.mark.parametrize("form", ["pickle", "flood", "flood at once", "ready"])
def test_a_worker_that_sends_what_is_no_answer_is_replaced(open_pool, make_task, monkeypatch, tmp_path, form):
    touched = tmp_path / "touched"
    data = {
        "pickle": pickle.dumps(Touch(touched)) + b"\n",
        "flood": b"x" * 60_000,
        "flood at once": b'{"kind": "progress", "stage": "map", "views_done": 0, "views": 1}\n' + b"x" * 60_000,
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


def test_a_missing_input_is_an_error_of_the_parent(open_pool, make_task):
    task = make_task(FAST)
    task.source.unlink()
    with pytest.raises(FileNotFoundError):
        run(open_pool(), task)


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


def test_the_parent_process_does_not_import_what_tasks_need():
    heavy = {"onnxruntime", "embreex", "OpenGL", "PIL", "imagecodecs", "trimesh", "ciir.models.session"}
    code = f"import sys, ciir.service.jobs.workers.pool; print(sorted({heavy} & set(sys.modules)))"
    assert run_python("-c", code, cwd=ROOT).stdout.strip() == "[]"
