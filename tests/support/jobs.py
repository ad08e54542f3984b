"""Jobs, consumers and a Redis server for tests, and a pool without worker processes."""

import hashlib
import io
import os
import shutil
import subprocess
import tempfile
import threading
import time
from pathlib import Path

from ciir.errors import WorkerDied
from ciir.service.jobs.files import RECORD
from ciir.service.jobs.job import FINAL, Problem, Request, Result
from ciir.service.jobs.jobs import Jobs
from ciir.service.jobs.workers.consumer import Consumer
from ciir.service.settings import Settings
from tests.support.waiting import wait_until


def submit_data(jobs, data=b"data", client="", **options):
    """Submits a job whose input is `data`."""
    return jobs.submit(Request("upload.png", options, None), io.BytesIO(data), client)[0]


def wait_for_end(jobs, id_, states=FINAL):
    """Waits until the job is in one of `states`, and returns it."""
    return wait_until(lambda: (job := jobs.get(id_)) and job.state in states and job)


def read_result(jobs, id_):
    """Reads the bytes of a job's result."""
    with jobs.open_result(id_) as file:
        return file.read()


def make_result(data=b"result"):
    """Makes the result record of a run that published `data`."""
    return Result("png", len(data), {"timings_ms": {}}, hashlib.sha256(data).hexdigest())


def publish_result(jobs, run, data=b"result"):
    """Writes and publishes the result file of a run."""
    with jobs.files.open_run(run.input, run.output) as files:
        files.target.write_bytes(data)
        files.publish()


def finish_job(jobs, job, data=b"result", lease="c-1"):
    """Finishes the job with `data` as its result, and returns it."""
    run = jobs.lifecycle.start(job.id, lease)
    publish_result(jobs, run, data)
    assert jobs.lifecycle.finish(run, make_result(data))
    return jobs.get(job.id)


def fail_job(jobs, job, status):
    """Makes the job fail with `status`, and returns it."""
    assert jobs.lifecycle.finish(jobs.lifecycle.start(job.id, "c-1"), Problem(status, "Title", "detail"))
    return jobs.get(job.id)


def set_clock(monkeypatch, seconds):
    monkeypatch.setattr(time, "time", lambda: seconds)


def run_in_threads(function, count):
    """Calls `function` in `count` threads."""
    threads = [threading.Thread(target=function) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def list_files(jobs):
    """Lists all files of the jobs, relative to their folder, without the records that belong to inputs."""
    folder = jobs.folder / "files"
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    return sorted(name for name in names if not (name.endswith(RECORD) and name.removesuffix(RECORD) in names))


def read_metrics(metrics, *names):
    """Reads the values of metrics, given by their names and labels in Prometheus' text format."""
    lines = dict(line.rsplit(" ", 1) for line in metrics.text().decode().splitlines() if not line.startswith("#"))
    return [float(lines[name]) for name in names]


def raise_worker_died(task, progress, cancelled):
    raise WorkerDied("was ended by signal 9 (Killed)")


def write_double(task, progress, cancelled):
    """Does a task's work: writes the input's bytes twice."""
    task.target.write_bytes(task.source.read_bytes() * 2)
    return Result("png", task.target.stat().st_size, {"timings_ms": {"total": 1.0}})


class StandInPool:
    """Runs tasks in the calling thread with `work(task, progress, cancelled)`, which a test may replace."""

    def __init__(self, work=write_double):
        self.work = work
        self.started = []
        """The ids of the jobs whose tasks were started."""

    def run(self, task, hooks):
        self.started.append(task.id)
        hooks.begun(os.getpid())
        return self.work(task, hooks.progress, hooks.cancelled)


class JobService:
    """Jobs and consumers that share a folder, closed at the end."""

    def __init__(self, folder):
        self.folder = folder
        self._jobs, self._consumers = [], []

    def open_jobs(self, **settings):
        """Opens the jobs in the folder, as another process would."""
        jobs = Jobs(Settings(folder=self.folder).model_copy(update=settings))  # unchecked, for stores in memory
        self._jobs.append(jobs)
        return jobs

    def start_consumer(self, jobs, pool, threads=1):
        """Starts a consumer of `jobs` that runs their tasks in `pool`."""
        consumer = Consumer(jobs, pool, threads)
        consumer.start()
        self._consumers.append(consumer)
        return consumer

    def stop_consumer(self, consumer, seconds=60.0):
        """Stops a consumer, whose running tasks have `seconds` to finish."""
        self._consumers.remove(consumer)
        consumer.stop(seconds)

    def close(self):
        while self._consumers:
            self._consumers.pop().stop(0)
        while self._jobs:
            self._jobs.pop().close()


class RedisServer:
    """A Redis server behind a socket in its own folder. It keeps its data when it is killed."""

    def __init__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="ciir-"))  # short: a socket's path has at most 107 bytes
        self.url = f"unix://{self.folder}/socket"
        self.process = None

    def start(self):
        command = ["redis-server", "--port", "0", "--unixsocket", f"{self.folder}/socket", "--dir", str(self.folder)]
        command += ["--appendonly", "yes", "--appendfsync", "always", "--save", ""]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL)  # noqa: S603 - our own
        wait_until(self._answers)

    def _answers(self):
        ping = ["redis-cli", "-s", f"{self.folder}/socket", "ping"]
        return b"PONG" in subprocess.run(ping, capture_output=True, check=False).stdout  # noqa: S603

    def call(self, *command):
        """Runs a command of `redis-cli` and returns its output."""
        line = ["redis-cli", "-s", f"{self.folder}/socket", *command]
        return subprocess.run(line, capture_output=True, check=True, text=True).stdout  # noqa: S603 - our own

    def kill(self):
        self.process.kill()
        self.process.wait()

    def close(self):
        self.kill()
        shutil.rmtree(self.folder)
