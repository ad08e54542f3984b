"""What the routes ask of the engine is in web/; here is its life."""

import io
import threading

import pytest

from ciir.errors import NotReady, QueueUnavailable
from ciir.service.jobs import engine as engine_module
from ciir.service.jobs.engine import Engine
from ciir.service.jobs.job import Problem, Request
from ciir.service.metrics import Metrics
from ciir.service.settings import Settings


class Pool:
    """Refuses everything, once it may."""

    def __init__(self):
        self.calls, self.ready = [], False
        self.go = threading.Event()

    def start(self):
        self.calls.append("start")

    def run(self, work, *, progress, cancelled):
        self.calls.append("run")
        assert self.go.wait(30)
        return Problem(422, "No", "no")

    def is_ready(self):
        return self.ready

    def count_ready(self):
        return 3

    def close(self):
        self.calls.append("close")


@pytest.fixture
def pool():
    return Pool()


@pytest.fixture
def engine(tmp_path, pool):
    engine = Engine(Settings(folder=tmp_path, workers=1), Metrics(), pool)
    yield engine
    pool.go.set()
    engine.close()


def submit(engine):
    return engine.jobs.submit(Request("upload.png", {}, None), io.BytesIO(b"x"), size=1)


def test_the_pool_starts_with_the_engine_and_jobs_wait_until_then(engine, pool):
    job = submit(engine)
    assert (pool.calls, engine.jobs.get(job.id).state) == ([], "queued")
    engine.start()
    assert pool.calls[0] == "start"
    pool.go.set()
    while engine.jobs.get(job.id).state != "failed":
        pass
    assert engine.jobs.get(job.id).problem.detail == "no"


def test_what_is_admitted_and_what_is_ready(engine, pool):
    engine.start()
    for check in (engine.check_accepting, engine.check_ready):
        with pytest.raises(NotReady, match="loaded"):
            check()
    pool.ready = True
    engine.check_ready()
    pool.ready = False  # workers are replaced
    engine.check_accepting()
    with pytest.raises(NotReady, match="worker"):
        engine.check_ready()
    engine.stop_accepting()
    for check in (engine.check_accepting, engine.check_ready):
        with pytest.raises(NotReady, match="stopping"):
            check()


def test_draining_waits_for_what_runs_and_takes_nothing_more(engine, pool):
    engine.start()
    job = submit(engine)
    while "run" not in pool.calls:
        pass
    draining = threading.Thread(target=engine.drain)
    draining.start()
    while not engine._consumer._stopping.is_set():
        pass
    other = engine.jobs.submit(Request("upload.png", {}, None), io.BytesIO(b"y"), size=1)
    assert draining.is_alive()
    pool.go.set()
    draining.join(30)
    assert not draining.is_alive()
    assert engine.jobs.get(job.id).state == "failed"
    assert (engine.jobs.get(other.id).state, pool.calls.count("run")) == ("queued", 1)
    engine.drain()  # again: nothing is left to do
    engine.close()
    assert pool.calls[-1] == "close"


def test_figures_of_the_queue(engine, monkeypatch):
    submit(engine)
    engine.update_gauges()
    text = engine.metrics.text().decode()
    for line in ("ciir_queue_waiting 1.0", "ciir_queue_running 0.0", "ciir_queue_up 1.0", "ciir_workers 3.0"):
        assert line in text

    def gone():
        raise QueueUnavailable("gone")

    monkeypatch.setattr(engine.jobs, "waiting", gone)
    engine.update_gauges()
    assert "ciir_queue_up 0.0" in engine.metrics.text().decode()


def test_without_workers_there_are_jobs_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(engine_module, "Consumer", None)
    engine = Engine(Settings(folder=tmp_path, workers=0), Metrics())
    engine.start()
    engine.check_ready()
    assert submit(engine).state == "queued"
    assert "ciir_workers 0.0" in engine.metrics.text().decode()
    engine.close()


def test_one_that_is_drained_while_it_starts_comes_to_its_end(engine, pool):
    drain = threading.Thread(target=engine.drain)

    def start_slowly():
        pool.calls.append("start")
        drain.start()  # as SIGTERM does it
        drain.join(0.3)

    pool.start = start_slowly
    engine.start()
    drain.join(30)
    assert not drain.is_alive()
    engine.start()  # which does nothing any more
    engine.close()
    assert pool.calls == ["start", "close"]
    assert [thread.name for thread in threading.enumerate() if thread.name.startswith("consumer")] == []
