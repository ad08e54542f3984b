import io
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import pytest

from ciir.service.jobs.job import Request, Result
from ciir.service.jobs.jobs import Jobs
from ciir.service.jobs.queue import Queue
from ciir.service.jobs.workers.consumer import Consumer
from ciir.service.settings import Settings

PATIENCE = 60.0


def until(condition, seconds=PATIENCE):
    """What `condition` returns, once that is true."""
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline, "it didn't come about in time"
        time.sleep(0.005)
    return found


class StandInPool:
    """Writes the input's bytes twice, at once; `work` may be replaced."""

    def __init__(self):
        self.begun = []
        self.work = self.double

    def run(self, work, *, progress, cancelled):
        self.begun.append(work.id)
        return self.work(work, progress, cancelled)

    @staticmethod
    def double(work, progress, cancelled):
        work.target.write_bytes(work.source.read_bytes() * 2)
        return Result("png", work.target.stat().st_size, {"timings_ms": {"total": 1.0}})


class RedisServer:
    """A Redis server of our own, behind a socket in a folder of its own, that forgets nothing when it is stopped."""

    def __init__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="ciir-"))  # short: a socket's path has 107 bytes at most
        self.url = f"unix://{self.folder}/socket"
        self.process = None

    def start(self):
        command = ["redis-server", "--port", "0", "--unixsocket", f"{self.folder}/socket", "--dir", str(self.folder)]
        command += ["--appendonly", "yes", "--appendfsync", "always", "--save", ""]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL)  # noqa: S603 - our own
        until(self.answers)

    def answers(self):
        ping = ["redis-cli", "-s", f"{self.folder}/socket", "ping"]
        return b"PONG" in subprocess.run(ping, capture_output=True, check=False).stdout  # noqa: S603

    def kill(self):
        self.process.kill()
        self.process.wait()

    def close(self):
        self.kill()
        shutil.rmtree(self.folder)


@pytest.fixture
def redis_server():
    if shutil.which("redis-server") is None:
        pytest.skip("no redis-server here; Debian's package of that name brings it")
    server = RedisServer()
    server.start()
    yield server
    server.close()


@pytest.fixture(params=["sqlite", "redis"])
def queue_url(request):
    return request.getfixturevalue("redis_server").url if request.param == "redis" else ""


@pytest.fixture
def queue(queue_url, tmp_path):
    queue = Queue(tmp_path, queue_url)
    yield queue
    queue.close()


class Service:
    """Jobs and consumers on one folder, all closed in the end."""

    def __init__(self, folder, **settings):
        self.folder, self.settings = folder, settings
        self._open, self._consumers = [], []

    def jobs(self, **settings):
        jobs = Jobs(Settings(folder=self.folder, **self.settings, **settings))
        self._open.append(jobs)
        return jobs

    def consumer(self, jobs, pool, threads=1):
        consumer = Consumer(jobs, pool, threads)
        consumer.start()
        self._consumers.append(consumer)
        return consumer

    def stop(self, consumer, seconds=PATIENCE):
        self._consumers.remove(consumer)
        consumer.stop(seconds)

    def close(self):
        while self._consumers:
            self._consumers.pop().stop(0)
        while self._open:
            self._open.pop().close()


@pytest.fixture
def service(tmp_path):
    service = Service(tmp_path / "service")
    yield service
    service.close()


@pytest.fixture
def jobs(service):
    return service.jobs()


@pytest.fixture
def pool():
    return StandInPool()


class Helpers:
    """What test modules can't import."""

    until = staticmethod(until)
    Pool = StandInPool

    @staticmethod
    def request(name="upload.png", form=None, **options):
        return Request(name, options, form)

    @staticmethod
    def submit(jobs, data=b"data", **options):
        return jobs.submit(Helpers.request(**options), io.BytesIO(data), size=len(data))

    @staticmethod
    def wait(jobs, id_, *states):
        def there():
            job = jobs.get(id_)
            return job if job is not None and job.state in (states or ("done", "failed", "cancelled")) else None

        return until(there)

    @staticmethod
    def all_files(folder):
        return sorted(str(path.relative_to(folder)) for path in (folder / "files").rglob("*") if path.is_file())


@pytest.fixture
def helpers():
    return Helpers
