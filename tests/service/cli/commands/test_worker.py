"""Two processes that share a queue, as two containers or machines do."""

import re
import socket
from pathlib import Path

import httpx2
import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from ciir.service.cli.main import main
from tests.support.inputs import EIA, EIA_PNG
from tests.support.servers import find_workers, run_ciir, run_python, run_server
from tests.support.waiting import wait_until

pytestmark = pytest.mark.slow


def test_a_worker_does_what_a_server_without_workers_takes_in(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    folder = str(tmp_path / "shared")
    worker = {"CIIR_FOLDER": folder, "CIIR_WORKERS": "1", "CIIR_METRICS_PORT": str(port), "CIIR_LOG_FORMAT": "json"}
    with (
        run_ciir(tmp_path / "worker.log", "worker", **worker),
        run_server(tmp_path / "web.log", CIIR_FOLDER=folder, CIIR_WORKERS="0", CIIR_SYNC_SECONDS="60") as server,
    ):
        fields = {"lenses": "6x9", "views": "1,2", "model": "none"}
        files = {"file": ("a.png", EIA_PNG)}
        answer = httpx2.post(f"{server.url}/v1/reconstructions", files=files, data=fields, timeout=60)
        assert answer.status_code == 200, answer.text
        assert np.array_equal(decode(answer.content, name="x"), EIA[1::4, 2::4])
        counted = httpx2.get(f"http://127.0.0.1:{port}/metrics").text
        assert re.search(r'^ciir_jobs_ended_total\{status="200"\} 1\.0$', counted, re.MULTILINE)
        assert re.search(r"^ciir_workers 1\.0$", counted, re.MULTILINE)
        assert not re.search(r"^ciir_(http|queue)_", counted, re.MULTILINE)
        assert "ciir_jobs_ended_total{" not in httpx2.get(f"{server.url}/metrics").text
    text = (tmp_path / "worker.log").read_text()
    assert '"message": "1 worker process takes jobs' in text
    assert '"message": "stopping' in text


def test_the_queues_password_is_in_no_log(tmp_path):
    log = tmp_path / "log"
    with run_ciir(log, "worker", CIIR_QUEUE="redis://:swordfish@127.0.0.1:1/0", CIIR_WORKERS="1"):
        wait_until(lambda: "takes jobs" in log.read_text())
    assert "jobs are in redis://...@127.0.0.1:1/0, inputs and results in /" in log.read_text()
    assert "swordfish" not in log.read_text()


@pytest.mark.parametrize("words", [("worker",), ("serve", "--port", "0")])
def test_secrets_are_in_no_environment(tmp_path, words):
    secret = {"CIIR_API_KEYS": "swordfish", "CIIR_QUEUE": "redis://:swordfish@127.0.0.1:1/0", "AWS_X": "swordfish"}
    with run_ciir(tmp_path / "log", *words, CIIR_WORKERS="1", **secret) as process:
        (worker,) = wait_until(lambda: find_workers(process.pid))
        parent = Path(f"/proc/{process.pid}/environ").read_bytes()
        environment = Path(f"/proc/{worker}/environ").read_bytes()
    assert b"HOME=/" in parent
    assert b"CIIR_WORKERS" not in environment
    assert b"swordfish" not in parent + environment


@pytest.mark.parametrize(
    ("settings", "words"),
    [({"CIIR_WORKERS": "0"}, "CIIR_WORKERS: 0"), ({"CIIR_QUEUE": "nowhere"}, "CIIR_QUEUE: 'nowhere'")],
)
def test_settings_that_make_no_sense(monkeypatch, capsys, settings, words):
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    assert main(["worker"]) == 2
    text = capsys.readouterr().err
    assert (text.count("\n"), words in text) == (1, True), text


def test_a_port_for_metrics_that_is_taken(monkeypatch, tmp_path):
    monkeypatch.setenv("CIIR_FOLDER", str(tmp_path))
    with socket.create_server(("0.0.0.0", 0)) as taken:  # noqa: S104 - as it listens
        monkeypatch.setenv("CIIR_METRICS_PORT", str(taken.getsockname()[1]))
        done = run_python("-m", "ciir", "worker", timeout=60)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "CIIR_METRICS_PORT" in done.stderr
