"""Worker processes and servers that are killed lose no job."""

import io
import os
import re
import signal
import subprocess
import sys
import zipfile

import httpx2
import numpy as np
import pytest

from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.jobs.job import FINAL, Request
from ciir.service.jobs.workers import worker
from ciir.service.jobs.workers.pool import Pool
from ciir.service.jobs.workers.task import Hooks
from ciir.service.pipeline import run as pipeline
from ciir.service.pipeline.options import Options
from ciir.service.settings import Settings
from tests.support.inputs import make_picture
from tests.support.jobs import wait_for_end
from tests.support.servers import find_workers
from tests.support.waiting import wait_until
from tests.support.workers.pools import COLD

pytestmark = pytest.mark.slow

OPTIONS = {"lenses": "70x70", "pixels": "5x5", "views": "all", "scale": "4", "backend": "raytrace", "model": "bicubic"}
ASYNC = {"Prefer": "respond-async"}
POST = "/v1/reconstructions"
STAGES = ("decode", "plan", "render", "upscale", "written")
"""The last one: the first views are written, of several batches."""


def make_obj(triangles=10_000, note=""):
    """Random triangles, each `note` another file; OBJ, since a new worker process needs a second to import trimesh."""
    random = np.random.default_rng(1)
    corners = random.uniform(-1, 1, (triangles, 1, 3)) + random.uniform(-0.05, 0.05, (triangles, 3, 3))
    lines = [f"# {note}", *("v {:.4f} {:.4f} {:.4f}".format(*corner) for corner in corners.reshape(-1, 3))]
    lines += [f"f {first} {first + 1} {first + 2}" for first in range(1, 3 * triangles, 3)]
    return "\n".join(lines).encode()


def read_views(file):
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name.endswith(".png")}


class Killer:
    """A pool whose worker process is killed when it first reports `stage`."""

    def __init__(self, pool):
        self._pool = pool
        self.stage, self.killed = "", []

    def run(self, task, hooks):
        pids = []

        def keep_pid(pid):
            pids.append(pid)
            hooks.begun(pid)

        def kill_in_stage(data):
            stage = "written" if data["views_done"] else data["stage"]
            if stage == self.stage and self.stage not in self.killed:
                self.killed.append(self.stage)
                os.kill(pids[-1], signal.SIGKILL)
            hooks.progress(data)

        return self._pool.run(task, Hooks(keep_pid, kill_in_stage, hooks.cancelled))


def test_a_worker_that_is_killed_in_each_stage_fails_no_job(service, monkeypatch):
    monkeypatch.setattr(worker, "MODULE", COLD)  # six worker processes, each of which would warm up for a second
    settings = Settings(folder=service.folder, workers=1)
    pool = Pool(settings)
    killer = Killer(pool)
    jobs = service.open_jobs()
    service.start_consumer(jobs, killer)
    file = io.BytesIO()
    with FileWriter(file, "zip") as writer:
        pipeline.reconstruct(Bundle.from_upload("upload.obj", make_obj()), Options.parse(OPTIONS), writer)
    expected = read_views(file)
    try:
        for stage in STAGES:
            killer.stage = stage
            data = make_obj(note=stage)
            job, _ = jobs.submit(Request("upload.obj", OPTIONS, "zip"), io.BytesIO(data))
            job = wait_for_end(jobs, job.id)
            assert (job.state, job.worker_deaths, job.attempts) == ("done", 1, 2), job.problem
            with jobs.open_result(job.id) as file:
                assert read_views(file) == expected
    finally:
        service.close()
        pool.close()
    assert killer.killed == list(STAGES)


@pytest.fixture
def start_server(tmp_path):
    """Starts `ciir serve` with one worker; returns the process, and its URL once it is ready. Kills it at the end."""
    processes = []

    def start(**environment):
        log = tmp_path / f"log{len(processes)}"
        environment = {"CIIR_FOLDER": str(tmp_path / "service"), "CIIR_WORKERS": "1"} | environment
        command = [sys.executable, "-m", "ciir", "serve", "--port", "0"]
        with log.open("wb") as output:
            process = subprocess.Popen(command, stdout=output, stderr=output, env=os.environ | environment)  # noqa: S603
        processes.append(process)

        def find_url():
            assert process.poll() is None, log.read_text()
            return re.search(r"http://[\d.]+:\d+", log.read_text())

        base = wait_until(find_url)[0]
        wait_until(lambda: httpx2.get(f"{base}/readyz").status_code == 200)
        return process, base

    yield start
    for process in processes:
        process.kill()
        process.wait()


def test_a_server_that_is_killed_with_fifty_jobs_waiting_loses_none(start_server):
    eias = [make_picture(12, 15, 3, np.uint8, seed) for seed in range(51)]
    process, url = start_server()
    os.kill(find_workers(process.pid)[0], signal.SIGSTOP)  # the first job does not end, so all others wait
    with httpx2.Client() as client:
        places = []
        for eia in eias:
            files = {"file": ("eia.png", encode_png(eia))}
            response = client.post(f"{url}{POST}", files=files, data={"lenses": "4x5", "model": "none"}, headers=ASYNC)
            assert response.status_code == 202
            places.append(response.headers["location"])
        wait_until(lambda: client.get(f"{url}{places[0]}").json()["state"] == "running")
        assert [client.get(f"{url}{place}").json()["state"] for place in places[1:]] == ["queued"] * 50
    process.kill()
    process.wait()
    process, url = start_server()
    with httpx2.Client() as client:
        for index, (place, eia) in enumerate(zip(places, eias, strict=True)):
            status = wait_until(lambda place=place: poll(client, f"{url}{place}"))
            assert (status["state"], status["attempts"]) == ("done", 2 if index == 0 else 1)
            result = client.get(f"{url}{place}/result").content
            assert np.array_equal(decode(result, name="x"), eia[1::3, 1::3])


def test_a_job_under_which_two_workers_are_killed_can_be_posted_again(start_server, tmp_path):
    process, url = start_server()
    data = {"lenses": "400x400", "views": "all", "model": "none", "backend": "raytrace"}  # half a minute
    with httpx2.Client() as client:

        def post():
            return client.post(f"{url}{POST}", files={"file": ("mesh.obj", make_obj())}, data=data, headers=ASYNC)

        def find_run(attempts):
            status = client.get(f"{url}{place}").json()
            return status["state"] == "running" and status["attempts"] == attempts and status["progress"]

        place = post().headers["location"]
        for attempts in (1, 2):
            wait_until(lambda attempts=attempts: find_run(attempts))
            worker = find_workers(process.pid)[0]
            if attempts == 2:
                metrics = client.get(f"{url}/metrics").text
                assert 'ciir_queue_jobs{lane="large",state="running"} 1.0' in metrics
                assert (
                    float(re.search(r'ciir_queue_oldest_seconds{lane="large",state="running"} (\S+)', metrics)[1]) > 0
                )
            os.kill(worker, signal.SIGKILL)  # as the kernel does when memory is short
        wait_until(lambda: client.get(f"{url}{place}").json()["state"] == "failed")
        failed = client.get(f"{url}{place}/result")
        assert (failed.status_code, "retry-after" in failed.headers) == (503, False)  # only a POST helps
        assert post().json()["attempts"] == 0  # not the failed job, but a new one
        wait_until(lambda: find_run(1))
        assert [client.delete(f"{url}{place}").json()["state"] for _ in range(2)] == ["cancelled"] * 2
        assert client.get(f"{url}{place}").status_code == 404
    log = (tmp_path / "log0").read_text()
    assert re.search(rf"run 2 begins in worker process {worker}, large lane: upload.obj {{.*400x400", log)
    assert re.search(r"after [\d.]+ s the worker process was ended by signal 9", log)


def test_a_redis_that_is_restarted_loses_no_job(start_server, redis_server):
    process, url = start_server(CIIR_QUEUE=redis_server.url)
    worker = find_workers(process.pid)[0]
    os.kill(worker, signal.SIGSTOP)
    eias = [make_picture(12, 15, 3, np.uint8, seed) for seed in range(4)]
    with httpx2.Client(timeout=60) as client:

        def post(eia, headers):
            files = {"file": ("eia.png", encode_png(eia))}
            return client.post(f"{url}{POST}", files=files, data={"lenses": "4x5", "model": "none"}, headers=headers)

        def get_readyz_status():
            return client.get(f"{url}/readyz").status_code

        places = [post(eia, ASYNC).headers["location"] for eia in eias[:3]]
        redis_server.kill()
        wait_until(lambda: get_readyz_status() == 503)
        refused = post(eias[3], {})
        assert (refused.status_code, refused.headers["content-type"]) == (503, "application/problem+json")
        os.kill(worker, signal.SIGCONT)
        redis_server.start()
        wait_until(lambda: get_readyz_status() == 200)
        for place, eia in zip(places, eias, strict=False):
            status = wait_until(lambda place=place: poll(client, f"{url}{place}"))
            assert (status["state"], status["attempts"]) == ("done", 1)
            assert np.array_equal(decode(client.get(f"{url}{place}/result").content, name="x"), eia[1::3, 1::3])
        assert post(eias[3], {}).status_code == 200


def poll(client, url):
    """The status of a job that has ended, else None."""
    status = client.get(url).json()
    return status if status["state"] in FINAL else None
