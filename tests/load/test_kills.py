import shutil

import pytest

from tests.load import kills

pytestmark = pytest.mark.slow


@pytest.fixture
def done(tmp_path, monkeypatch):
    """Clients with one job that is done, the answers that they get now, and the file of its result."""
    file = tmp_path / "service" / "files" / "results" / "1.a"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"result")
    (tmp_path / "answers").mkdir()
    clients = kills.Clients(0, tmp_path, 0, 0)
    answers = {"/result": b"result", "/events": b"event: running\n\nevent: done\n\n"}
    monkeypatch.setattr(clients, "_ask", lambda method, path: ({}, answers[path.removeprefix(f"{kills.PATH}/1")]))
    clients.store_outcome(7, "1", 1)
    return clients, answers, file


def test_a_result_that_stays_is_no_change(done):
    clients, _, _ = done
    assert list(clients.list_changes()) == []


@pytest.mark.parametrize(
    ("path", "answer"), [("/result", b"other"), ("/events", b"event: done\n\nevent: running\n\nevent: done\n\n")]
)
def test_another_result_and_a_second_end_are_changes(done, path, answer):
    clients, answers, _ = done
    answers[path] = answer
    assert len(list(clients.list_changes())) == 1


@pytest.mark.parametrize("change", ["replaced", "removed"])
def test_a_file_that_was_written_again_or_lost_is_a_change(done, change):
    clients, _, file = done
    file.rename(file.with_name("old"))
    if change == "replaced":
        file.write_bytes(b"result")
    assert len(list(clients.list_changes())) == 1


@pytest.mark.skipif(shutil.which("redis-server") is None, reason="no redis-server here")
def test_no_job_is_lost_when_web_process_workers_and_redis_are_killed(tmp_path):
    lines = list(kills.measure_kills("redis", tmp_path / "run", jobs=4, kills=4, seconds=60, seed=4))
    assert [line.text for line in lines if line.holds is False] == []
    assert "redis: 1, web: 1, worker: 1, worker process: 1" in lines[0].text
