"""The engine's start, drain and close; the routes that use it are tested in web/."""

import threading
import time

import pytest

from ciir.errors import NotReady, QueueUnavailable
from ciir.service.jobs import engine as engine_module
from ciir.service.jobs.engine import Engine
from ciir.service.jobs.job import Problem
from ciir.service.jobs.workers.recovery import DEAD_SECONDS
from ciir.service.metrics import Metrics
from ciir.service.settings import Settings
from tests.support.jobs import read_metrics, submit_data, wait_for_end


class Pool:
    """Fails every task, once `go` is set."""

    def __init__(self):
        self.calls, self.ready, self.start_error = [], False, ""
        self.go = threading.Event()

    def start(self):
        self.calls.append("start")

    def run(self, task, hooks):
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


def test_jobs_wait_until_the_engine_starts(engine, pool):
    job = submit_data(engine.jobs)
    assert (pool.calls, engine.jobs.get(job.id).state) == ([], "queued")
    engine.start()
    assert pool.calls[0] == "start"
    pool.go.set()
    assert wait_for_end(engine.jobs, job.id).problem.detail == "no"


def test_when_it_accepts_jobs_and_is_ready(engine, pool):
    engine.start()
    for check in (engine.check_accepting, engine.check_ready):
        with pytest.raises(NotReady, match="loaded"):
            check()
    pool.ready = True
    engine.check_ready()
    pool.ready = False  # as while workers are replaced
    engine.check_accepting()
    with pytest.raises(NotReady, match="worker"):
        engine.check_ready()
    engine.stop_accepting()
    for check in (engine.check_accepting, engine.check_ready):
        with pytest.raises(NotReady, match="stopping"):
            check()


def test_it_is_not_ready_while_the_queue_takes_no_writes(engine, pool, monkeypatch):
    engine.start()
    pool.ready = True

    def fail():
        raise QueueUnavailable("no writes")

    monkeypatch.setattr(engine.jobs.queue, "check", fail)
    engine.check_accepting()
    with pytest.raises(QueueUnavailable, match="no writes"):
        engine.check_ready()


def test_it_is_not_ready_while_the_store_of_its_files_fails(engine, pool, monkeypatch):
    engine.start()
    pool.ready = True

    def fail():
        raise QueueUnavailable("no store")

    monkeypatch.setattr(engine.jobs.files, "check", fail)
    engine.check_accepting()
    with pytest.raises(QueueUnavailable, match="no store"):
        engine.check_ready()


def test_gauges_of_the_queue(engine, monkeypatch):
    submit_data(engine.jobs)
    engine.update_gauges()
    text = engine.metrics.text().decode()
    for line in (
        "ciir_queue_waiting 1.0",
        'ciir_queue_jobs{lane="small",state="queued"} 1.0',
        'ciir_queue_jobs{lane="large",state="running"} 0.0',
        "ciir_queue_up 1.0",
        "ciir_queue_consumers 0.0",
        "ciir_workers 3.0",
    ):
        assert line in text

    def fail():
        raise QueueUnavailable("no answer")

    monkeypatch.setattr(engine.jobs, "count_waiting", fail)
    engine.update_gauges()
    assert "ciir_queue_up 0.0" in engine.metrics.text().decode()


def test_the_oldest_of_the_jobs(engine, monkeypatch):
    ages = {("small", "queued"): [3.0, 9.0, 5.0], ("large", "queued"): [], ("large", "running"): [-1.0]}
    monkeypatch.setattr(engine.jobs, "measure_ages", lambda: ages)
    engine.update_gauges()
    lines = engine.metrics.text().decode().splitlines()
    name = "ciir_queue_oldest_seconds"
    assert f'{name}{{lane="small",state="queued"}} 9.0' in lines
    assert f'{name}{{lane="large",state="queued"}} 0.0' in lines
    assert f'{name}{{lane="large",state="running"}} 0.0' in lines  # the system clock was set back


def test_live_consumers_are_counted(engine, monkeypatch):
    now = 1000.0
    monkeypatch.setattr(time, "monotonic", lambda: now)

    def count(**heartbeats):
        for name, value in heartbeats.items():
            engine.jobs.queue.heartbeats.put(name, str(value).encode())
        engine.update_gauges()
        return read_metrics(engine.metrics, "ciir_queue_consumers")[0]

    assert count(a=1, b=1) == 2
    now += DEAD_SECONDS / 2
    assert count(a=2) == 2
    now += DEAD_SECONDS / 2
    assert count() == 1
    assert count(b=2) == 2
    now += 6 * DEAD_SECONDS  # the interval of a slow Prometheus
    assert count(a=3, b=3) == 2
    engine.jobs.queue.heartbeats.remove("a")  # it was stopped
    assert count() == 1


def test_without_workers_it_only_stores_jobs(tmp_path, monkeypatch):
    monkeypatch.setattr(engine_module, "Consumer", None)
    engine = Engine(Settings(folder=tmp_path, workers=0), Metrics())
    engine.start()
    engine.check_ready()
    assert submit_data(engine.jobs).state == "queued"
    assert "ciir_workers 0.0" in engine.metrics.text().decode()
    engine.close()


def test_a_drain_during_the_start(engine, pool):
    drain = threading.Thread(target=engine.drain)

    def start_slowly():
        pool.calls.append("start")
        drain.start()  # as on SIGTERM
        drain.join(0.3)

    pool.start = start_slowly
    engine.start()
    drain.join(30)
    assert not drain.is_alive()
    engine.start()  # does nothing after a drain
    engine.close()
    assert pool.calls == ["start", "close"]
    assert [thread.name for thread in threading.enumerate() if thread.name.startswith("consumer")] == []


def test_a_second_server_on_the_same_folder_is_reported(engine, tmp_path):
    place = f"jobs are in {tmp_path}, inputs and results in {tmp_path / 'files'}"
    assert engine.describe_place() == place
    second = Engine(Settings(folder=tmp_path, workers=1), Metrics(), Pool())
    expected = f"{place}; other processes on this machine that take these jobs too: 1"
    assert (second.describe_place(), engine.describe_place()) == (expected, expected)
    second.close()
    assert engine.describe_place() == place


def test_passwords_are_left_out_of_the_place(tmp_path):
    settings = Settings(folder=tmp_path, workers=0, queue="redis://:swordfish@127.0.0.1:1/0")
    engine = Engine(settings, Metrics())
    assert engine.describe_place().startswith("jobs are in redis://...@127.0.0.1:1/0, inputs and results in /")
    engine.close()
