"""Real worker processes, started by spawn as the server's are; what the work is stays real, too."""

import io
import json
import multiprocessing
import operator
import os
import signal
import threading
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ciir.errors import Cancelled, WorkerDied
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.formats import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.jobs.job import Problem, Request, Result
from ciir.service.jobs.workers import pool as module
from ciir.service.jobs.workers.pool import Pool
from ciir.service.jobs.workers.task import Task
from ciir.service.pipeline import run as pipeline
from ciir.service.pipeline.options import Options
from ciir.service.settings import Settings
from tests.support.inputs import CUBE
from tests.support.paths import ROOT
from tests.support.servers import run_python

FAST = {"lenses": "12x10", "pixels": "3x3", "model": "none", "backend": "raytrace"}
LONG = {"lenses": "400x400", "pixels": "15x15", "views": "all", "model": "none", "backend": "raytrace"}
"""Takes some ten seconds, so that something can be done meanwhile."""


@pytest.fixture
def opened(monkeypatch):
    """Pools of one worker, which isn't warm: its first work loads what it needs. Closed in the end."""
    monkeypatch.setattr(module, "warm_up", list)  # a function that is there in the other process, too
    pools = []

    def make(**settings):
        pools.append(Pool(Settings(**{"workers": 1} | settings)))
        return pools[-1]

    yield make
    for pool in pools:
        pool.close()
    assert not [child for child in multiprocessing.active_children() if "pebble" in child.name]


@pytest.fixture
def work(tmp_path):
    (tmp_path / "input").write_bytes(CUBE)

    def make(options, form=None, name="upload.off"):
        made = tmp_path / f"run {len(list(tmp_path.iterdir()))}"
        made.mkdir()
        return Task("an id", Request(name, options, form), tmp_path / "input", made / "result")

    return make


def run(pool, work, progress=lambda _: None, cancelled=None):
    return pool.run(work, progress=progress, cancelled=cancelled or threading.Event())


def until(condition):
    end = time.monotonic() + 60
    while not (found := condition()):
        assert time.monotonic() < end, "it never came to be"
        time.sleep(0.01)
    return found


def the_worker():
    children = [child for child in multiprocessing.active_children() if "pebble" in child.name]
    assert len(children) == 1
    return children[0].pid


class Doing:
    """Work that runs in a thread; `stages` holds what was told."""

    def __init__(self, pool, work):
        self.cancelled, self.told, self.came = threading.Event(), [], None
        self.thread = threading.Thread(target=self._run, args=(pool, work))
        self.thread.start()
        until(lambda: "encode" in self.stages())

    def stages(self):
        return [data["stage"] for data in self.told]

    def _run(self, pool, work):
        try:
            self.came = run(pool, work, self.told.append, self.cancelled)
        except (Cancelled, WorkerDied) as reason:
            self.came = reason

    def end(self):
        self.thread.join(60)
        assert not self.thread.is_alive()
        return self.came


def test_it_makes_what_the_pipeline_makes_and_tells_how_far_it_is(opened, work):
    options = FAST | {"views": "all"}
    told = []
    given = work(options, "zip")
    outcome = run(opened(), given, told.append)
    file = io.BytesIO()
    with FileWriter(file, "zip") as writer:
        report = pipeline.reconstruct(Bundle.from_upload("upload.off", CUBE), Options.parse(options), writer)
    assert pictures_in(file) == pictures_in(given.target)
    assert isinstance(outcome, Result)
    assert (outcome.format, outcome.size) == ("zip", given.target.stat().st_size)
    del report["views"]
    assert outcome.report | {"timings_ms": None} == as_json(report) | {"timings_ms": None}
    assert set(outcome.report["timings_ms"]) == set(report["timings_ms"])
    assert told[0] == {"stage": "decode", "views_done": 0, "views": 0}
    assert [data["stage"] for data in told] == ["decode", "plan", "render", "encode", "encode"]
    assert told[-1] == {"stage": "encode", "views_done": 9, "views": 9}


def as_json(report):
    return json.loads(json.dumps(report))


def pictures_in(file):
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
def test_what_is_wrong_with_a_request_is_a_problem(opened, work, options, status, words):
    problem = run(opened(), work(options))
    assert isinstance(problem, Problem)
    assert problem.status == status
    assert words in problem.detail


def test_what_takes_too_long_is_stopped(opened, work):
    pool = opened(job_seconds=0.5)
    problem = run(pool, work(LONG))
    assert (problem.status, problem.title) == (422, "Takes too long")
    assert "0.5 s" in problem.detail
    pool._seconds = 60
    assert isinstance(run(pool, work(FAST)), Result)  # by another process


def test_processor_time_is_limited(opened, work):
    problem = run(opened(worker_cpu_seconds=1), work(LONG))
    assert (problem.status, problem.title) == (422, "Takes too long")
    assert "1 s of processor time" in problem.detail


def test_what_is_not_wanted_any_more_is_stopped(opened, work):
    pool = opened()
    doing = Doing(pool, work(LONG))
    before = the_worker()
    doing.cancelled.set()
    assert isinstance(doing.end(), Cancelled)
    assert not Path(f"/proc/{before}").exists()
    assert isinstance(run(pool, work(FAST)), Result)
    cancelled = threading.Event()
    cancelled.set()
    with pytest.raises(Cancelled):
        run(pool, work(FAST), cancelled=cancelled)


def test_a_worker_that_is_killed_at_work(opened, work):
    pool = opened()
    doing = Doing(pool, work(LONG))
    os.kill(the_worker(), signal.SIGKILL)
    died = doing.end()
    assert isinstance(died, WorkerDied)
    assert str(died) == "was ended by signal 9 (Killed)"
    assert isinstance(run(pool, work(FAST)), Result)


def test_a_worker_that_is_killed_while_it_waits_costs_no_work(opened, work):
    pool = opened()
    assert isinstance(run(pool, work(FAST)), Result)
    before = the_worker()
    os.kill(before, signal.SIGKILL)
    assert isinstance(run(pool, work(FAST)), Result)
    until(lambda: pool.is_ready() and the_worker() != before)


def test_one_workers_death_is_nothing_to_another(opened, work):
    pool = opened(workers=2)
    one, other = Doing(pool, work(LONG)), Doing(pool, work(LONG))
    one.cancelled.set()
    assert isinstance(one.end(), Cancelled)
    told = len(other.told)
    until(lambda: len(other.told) > told)
    other.cancelled.set()
    assert isinstance(other.end(), Cancelled)


def test_a_worker_is_replaced_after_so_many_pieces_of_work(opened, work):
    pool = opened(worker_jobs=2)
    pids = []
    for _ in range(4):
        assert isinstance(run(pool, work(FAST), lambda _: pids.append(the_worker())), Result)
    distinct = list(dict.fromkeys(pids))
    assert len(distinct) == 2


def test_memory_is_limited(opened, work, tmp_path):
    (tmp_path / "input").write_bytes(encode_png(np.zeros((6000, 6000, 4), np.uint8)))  # some 100 KB
    pool = opened()
    pool._allowed = replace(pool._allowed, memory=2**29)  # less than a setting may be: quicker to fill
    problem = run(pool, work({"lenses": "3000x3000", "model": "none"}, name="upload.png"))
    assert isinstance(problem, Problem)
    assert (problem.status, problem.title) == (413, "Over a limit")
    assert "memory" in problem.detail
    assert not pool.is_ready()  # that process is not trusted any more
    until(pool.is_ready)


def test_the_results_size_is_limited(opened, work):
    options = FAST | {"lenses": "200x200", "pixels": "9x9", "views": "all"}
    problem = run(opened(worker_file_bytes=2**20), work(options, "npz"))
    assert (problem.status, problem.title) == (413, "Over a limit")
    assert "the result is over 1,048,576 bytes" in problem.detail


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_told(opened, work):
    given = work(FAST)
    given.target.symlink_to("/dev/full")
    problem = run(opened(), given)
    assert problem.status == 503
    assert "disk is full" in problem.detail


def test_a_fault_of_ours_is_told_and_logged(opened, work, caplog):
    pool, given = opened(), work(FAST)
    given.source.unlink()
    problem = run(pool, given)
    assert (problem.status, problem.detail.count("\n")) == (500, 0)
    assert "FileNotFoundError" in caplog.text
    assert pool.is_ready()


def test_models_that_cannot_be_loaded_are_told_and_tried_again(opened, monkeypatch, caplog):
    monkeypatch.setattr(module, "warm_up", operator.index)  # raises TypeError without an argument
    pool = opened()
    assert not pool.is_ready()
    until(lambda: pool.trouble)
    assert "TypeError" in pool.trouble
    until(lambda: "TypeError" in caplog.text)  # which is written after that
    monkeypatch.setattr(module, "warm_up", list)
    until(pool.is_ready)
    assert pool.trouble == ""


def test_what_a_worker_is_not_kept_from_is_logged(opened, monkeypatch, caplog):
    monkeypatch.setattr(module, "warm_up", dict.fromkeys)
    monkeypatch.setattr(module._Worker, "call", with_argument(module._Worker.call, ["the network"]))
    until(opened().is_ready)
    assert "not kept in: the network" in caplog.text


def with_argument(call, given):
    return lambda self, function, *args: call(self, function, *(args or (given,)))


def test_closing_ends_what_runs(opened, work):
    pool = opened()
    doing = Doing(pool, work(LONG))
    pool.close()
    assert isinstance(doing.end(), Cancelled)
    assert not pool.is_ready()
    with pytest.raises(Cancelled):
        run(pool, work(FAST))


def test_the_clock_on_the_wall_may_be_set(opened, work, monkeypatch):
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + 1e6)
    pool = opened()
    assert isinstance(run(pool, work(FAST)), Result)
    monkeypatch.setattr(time, "time", lambda: now() - 1e6)
    assert isinstance(run(pool, work(FAST)), Result)


def test_it_is_warm_before_it_is_ready():
    pool = Pool(Settings(workers=1))
    try:
        assert not pool.is_ready()
        until(pool.is_ready)
        (worker,) = pool._warm
        loaded = worker.call(eval, "sorted({'onnxruntime', 'embreex'} & set(__import__('sys').modules))").result(60)
    finally:
        pool.close()
    assert loaded == ["embreex", "onnxruntime"]


def test_who_asks_for_work_loads_nothing_of_what_does_it():
    heavy = (
        "{'onnxruntime', 'embreex', 'pyrender', 'OpenGL', 'PIL', 'imagecodecs', 'trimesh', 'renderer.readers.meshes'}"
    )
    code = f"import sys, service.jobs.workers.pool; print(sorted({heavy} & set(sys.modules)))"
    done = run_python("-c", code, cwd=ROOT)
    assert done.stdout.strip() == "[]"
