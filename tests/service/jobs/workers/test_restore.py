import os
import signal
import threading

import httpx2
import pytest

from ciir.errors import Cancelled
from ciir.service.jobs.queue import FILE
from ciir.service.jobs.workers.restore import restore_jobs
from tests.support.inputs import EIA_PNG
from tests.support.jobs import StandInPool, list_files, read_result, submit_data, wait_for_end, write_double
from tests.support.servers import find_workers, run_server
from tests.support.waiting import wait_until
from tests.support.web import post_file


def lose_database(service, jobs):
    jobs.close()
    for path in service.folder.glob(f"{FILE}*"):
        path.unlink()
    return service.open_jobs()


def test_without_its_database_an_accepted_job_runs(service, jobs, caplog):
    waiting, running = submit_data(jobs, b"ab", lenses="5x5", views="all"), submit_data(jobs, b"cd")
    jobs.lifecycle.start(running.id, "a-1")
    jobs = lose_database(service, jobs)
    service.start_consumer(jobs, StandInPool())
    for job, result in ((waiting, b"abab"), (running, b"cdcd")):
        restored = wait_until(lambda job=job: jobs.get(job.id))
        assert (restored.request, restored.lane, restored.created) == (job.request, job.lane, job.created)
        assert wait_for_end(jobs, job.id).state == "done"
        assert read_result(jobs, job.id) == result
        assert f"job {job.id}: its record was lost; queued again" in caplog.text
    wait_until(lambda: len(list_files(jobs)) == 2)


def test_jobs_run_after_redis_has_lost_its_data(service, redis_server):
    jobs = service.open_jobs(queue=redis_server.url)
    started, go = threading.Event(), threading.Event()

    def work(task, progress, cancelled):
        started.set()
        while not go.wait(0.01):
            if cancelled.is_set():
                raise Cancelled
        return write_double(task, progress, cancelled)

    service.start_consumer(jobs, StandInPool(work))
    running = submit_data(jobs, b"ab")
    assert started.wait(30)
    waiting = submit_data(jobs, b"cd")
    wait_until(jobs.queue.heartbeats.items)
    redis_server.call("flushall")
    assert jobs.get(waiting.id) is None
    go.set()
    for job, result in ((running, b"abab"), (waiting, b"cdcd")):
        wait_until(lambda job=job: (found := jobs.get(job.id)) and found.state == "done")
        assert read_result(jobs, job.id) == result


def test_jobs_that_are_known_are_not_restored(jobs):
    job = submit_data(jobs)
    for name in (job.input, ""):
        jobs.queue.active.remove(name)
        restore_jobs(jobs)
        assert (jobs.count_waiting(), jobs.get(job.id), list(jobs.queue.active.items())) == (1, job, [job.input])


def test_what_was_left_of_an_ended_job_is_removed(jobs):
    job = submit_data(jobs)
    folder = jobs.folder / "files" / "inputs"
    left = {path: path.read_bytes() for path in folder.iterdir()}
    assert len(left) == 2
    jobs.cancel(job.id)
    for path, data in left.items():  # as a power cut undoes a removal
        path.write_bytes(data)
    restore_jobs(jobs)
    assert (list(folder.iterdir()), jobs.get(job.id).state) == ([], "cancelled")


def test_records_that_cannot_be_used_are_left_or_removed(jobs, caplog):
    folder = jobs.folder / "files" / "inputs"
    (folder / "a.1.json").write_bytes(b"{}")
    job = submit_data(jobs)
    record = (folder / f"{job.input}.json").read_bytes()
    jobs.cancel(job.id)
    jobs.records.remove(job.id, lambda job: True)
    (folder / f"{job.input}.json").write_bytes(record)  # without its input
    restore_jobs(jobs)
    assert [path.name for path in folder.iterdir()] == ["a.1.json"]
    assert "a.1.json: not restored" in caplog.text
    assert jobs.get(job.id) is None


@pytest.mark.slow
def test_a_server_whose_database_is_damaged_loses_no_accepted_job(tmp_path):
    fields = {"lenses": "6x9", "model": "none"}
    asynchronously = {"Prefer": "respond-async"}
    with run_server(tmp_path / "log", CIIR_WORKERS="1", CIIR_DRAIN_SECONDS="0") as server:
        os.kill(find_workers(server.pid)[0], signal.SIGSTOP)
        with httpx2.Client(base_url=server.url) as client:
            places = [
                post_file(client, data=EIA_PNG, headers=asynchronously, views=views, **fields).headers["location"]
                for views in ("center", "cross")
            ]
    (tmp_path / "service" / FILE).unlink()
    with run_server(tmp_path / "log2", CIIR_WORKERS="1") as server, httpx2.Client(base_url=server.url) as client:
        for place in places:
            wait_until(lambda place=place: client.get(place).json().get("state") == "done")
            assert client.get(f"{place}/result").status_code == 200
