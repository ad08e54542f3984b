"""Docker commands, and the compose file's services as an object."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import time

import httpx2
import numpy as np

from ciir.renderer.writers.pictures import encode_png
from tests.support.paths import ROOT

IMAGE = "ciir:test"
REDIS = "redis:7-bookworm"
POST = "/v1/reconstructions"
PATIENCE = 120
"""Seconds to wait for anything."""


def run(*command, **options):
    """A command's output; where it fails, the error holds what it printed."""
    argv = [*map(str, command)]
    done = subprocess.run(argv, check=False, text=True, capture_output=True, **options)  # noqa: S603 - our own
    assert done.returncode == 0, f"{' '.join(argv)}: {done.stdout[-2000:]}{done.stderr[-6000:]}"
    return done.stdout.strip()


def succeeds(*command):
    """Whether there is such a command and it succeeds."""
    if shutil.which(command[0]) is None:
        return False
    return subprocess.run(command, check=False, capture_output=True).returncode == 0  # noqa: S603 - our own


def wait_for(met, what):
    """Waits until `met()` is true, and returns its value."""
    deadline = time.monotonic() + PATIENCE
    while not (found := met()):
        assert time.monotonic() < deadline, f"never: {what}"
        time.sleep(0.1)
    return found


def run_inside(container, program):
    """What Python prints in a container."""
    return run("docker", "exec", container, "python", "-c", program)


def inspect(container, template):
    return run("docker", "inspect", "--format", template, container)


def describe(container):
    return json.loads(run("docker", "inspect", container))[0]


def find_free_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def make_noise(height, width, seed):
    """A picture of noise, `(height, width, 3)` of 8 bits, and its PNG."""
    picture = np.random.default_rng(seed).integers(0, 255, (height, width, 3), np.uint8, endpoint=True)
    return picture, encode_png(picture)


def is_ready(url):
    """Whether a server is ready at `url`."""
    try:
        return httpx2.get(url + "/readyz", timeout=5).status_code == 200
    except httpx2.TransportError:
        return False


def post(url, data, name="eia.png", headers=None, **fields):
    return httpx2.post(url + POST, files={"file": (name, data)}, data=fields, headers=headers or {}, timeout=PATIENCE)


class Stack:
    """The compose file's services, in a project of their own, with its folder."""

    def __init__(self, compose, folder, environment=None):
        shutil.copy(ROOT / "docker-compose.yml", folder)
        self.folder, self._compose = folder, compose
        self._name = f"ciir-test-{os.getpid()}"
        port = find_free_port()
        self.url = f"http://127.0.0.1:{port}"
        self._environment = os.environ | {"CIIR_IMAGE": IMAGE, "CIIR_PORT": str(port)} | (environment or {})

    def __call__(self, *words):
        return run(*self._compose, "-p", self._name, *words, cwd=self.folder, env=self._environment)

    def start(self, *words):
        """A command of compose that goes on."""
        argv = [*self._compose, "-p", self._name, *words]
        return subprocess.Popen(  # noqa: S603 - our own
            argv, cwd=self.folder, env=self._environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def up(self, workers=1):
        """Starts the services, with so many workers, and waits until the server is ready."""
        self("up", "--detach", "--no-build", "--scale", f"worker={workers}")
        wait_for(lambda: is_ready(self.url), "the web process is ready")

    def containers(self, service):
        """Ids of those that run."""
        return self("ps", "--quiet", service).split()

    def submit(self, png, **fields):
        """The id of a job that is accepted, without waiting for it."""
        answer = post(self.url, png, headers={"Prefer": "respond-async"}, **fields)
        assert answer.status_code == 202, answer.text
        return answer.json()["id"]

    def status(self, id_):
        answer = httpx2.get(f"{self.url}{POST}/{id_}", timeout=PATIENCE)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def wait_until_done(self, id_):
        """The job's status once it is done."""
        status = wait_for(
            lambda: (found := self.status(id_))["state"] not in ("queued", "running") and found, "a job ends"
        )
        assert status["state"] == "done", status
        return status

    def result(self, id_):
        answer = httpx2.get(f"{self.url}{POST}/{id_}/result", timeout=PATIENCE)
        assert answer.status_code == 200, answer.text
        return answer.content

    def read_metric(self, container, name):
        """A metric of a worker, summed over all labels."""
        text = run_inside(
            container, "import urllib.request as w; print(w.urlopen('http://127.0.0.1:9100').read().decode())"
        )
        return sum(float(line.rpartition(" ")[2]) for line in text.splitlines() if line.startswith(name))
