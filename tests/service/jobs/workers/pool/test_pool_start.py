"""The start of worker processes, and what they write to the log."""

from pathlib import Path

from ciir.service.jobs.workers import pool as module
from ciir.service.jobs.workers import worker as worker_module
from ciir.service.jobs.workers.pool import Pool
from ciir.service.settings import Settings
from tests.support.waiting import wait_until
from tests.support.workers.pools import COLD


def test_a_worker_fills_no_log_and_forges_no_line(open_pool, monkeypatch, caplog):
    monkeypatch.setenv("PYTHON_WRITE", "5000")
    wait_until(open_pool().is_ready)
    wait_until(lambda: "its further lines are left out" in caplog.text)
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) == worker_module.LOG_LINES + 1
    assert all(line.startswith("worker process ") and line.isprintable() and len(line) < 2000 for line in lines)


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
    monkeypatch.setattr(module, "START_SECONDS", 3.0)
    monkeypatch.setenv("PYTHON_SLEEP", "1000")
    pool = open_pool()
    assert not pool.is_ready()
    wait_until(lambda: pool.start_error)
    assert "it was not ready after 3 s: it sleeps" in caplog.text
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
