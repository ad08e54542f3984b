"""The image, built, and the compose file's services, on a real Docker engine.

It takes minutes and a network to build with, so it runs only where it is asked for: `CIIR_TEST_CONTAINERS=1 python -m
pytest tests/containers`.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import httpx2
import numpy as np
import pytest

from ciir.renderer.writers.pictures import encode_png
from tests.support.paths import ROOT

IMAGE = "ciir:test"
REDIS = "redis:7-bookworm"
POST = "/v1/reconstructions"
PATIENCE = 120
"""Seconds after which what should have happened never will."""


def run(*command, **options):
    """A command's output; what it said is in the error where it fails."""
    words = [*map(str, command)]
    done = subprocess.run(words, check=False, text=True, capture_output=True, **options)  # noqa: S603 - our own
    assert done.returncode == 0, f"{' '.join(words)}: {done.stdout[-2000:]}{done.stderr[-6000:]}"
    return done.stdout.strip()


def works(*command):
    """Whether there is such a command and it succeeds."""
    if shutil.which(command[0]) is None:
        return False
    return subprocess.run(command, check=False, capture_output=True).returncode == 0  # noqa: S603 - our own


def until(met, what):
    """Waits until `met()` is true, and returns what it gave."""
    deadline = time.monotonic() + PATIENCE
    while not (found := met()):
        assert time.monotonic() < deadline, f"never: {what}"
        time.sleep(0.1)
    return found


def inside(container, program):
    """What Python prints in a container."""
    return run("docker", "exec", container, "python", "-c", program)


def inspect(container, template):
    return run("docker", "inspect", "--format", template, container)


def described(container):
    return json.loads(run("docker", "inspect", container))[0]


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def noise(height, width, seed):
    """A picture in which no two pixels are alike, `(height, width, 3)` of 8 bits, and its PNG."""
    picture = np.random.default_rng(seed).integers(0, 255, (height, width, 3), np.uint8, endpoint=True)
    return picture, encode_png(picture)


def answers(url):
    """Whether a server is ready there."""
    try:
        return httpx2.get(url + "/readyz", timeout=5).status_code == 200
    except httpx2.TransportError:
        return False


def post(url, data, name="eia.png", headers=None, **fields):
    return httpx2.post(url + POST, files={"file": (name, data)}, data=fields, headers=headers or {}, timeout=PATIENCE)


class Stack:
    """The compose file's services, in a project of their own, with its folder."""

    def __init__(self, compose, folder):
        shutil.copy(ROOT / "docker-compose.yml", folder)
        self.folder, self._compose = folder, compose
        self._name = f"ciir-test-{os.getpid()}"
        port = free_port()
        self.url = f"http://127.0.0.1:{port}"
        self._environment = os.environ | {"CIIR_IMAGE": IMAGE, "CIIR_PORT": str(port)}

    def __call__(self, *words):
        return run(*self._compose, "-p", self._name, *words, cwd=self.folder, env=self._environment)

    def up(self, workers=1):
        """Starts what doesn't run, with so many workers, and waits until requests are taken."""
        self("up", "--detach", "--no-build", "--scale", f"worker={workers}")
        until(lambda: answers(self.url), "the web process is ready")

    def containers(self, service):
        """Ids of those that run."""
        return self("ps", "--quiet", service).split()

    def submit(self, png, **fields):
        """The id of a job that is accepted and not waited for."""
        answer = post(self.url, png, headers={"Prefer": "respond-async"}, **fields)
        assert answer.status_code == 202, answer.text
        return answer.json()["id"]

    def status(self, id_):
        answer = httpx2.get(f"{self.url}{POST}/{id_}", timeout=PATIENCE)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def finished(self, id_):
        """The job's status once it is done."""
        status = until(
            lambda: (found := self.status(id_))["state"] not in ("queued", "running") and found, "a job ends"
        )
        assert status["state"] == "done", status
        return status

    def result(self, id_):
        answer = httpx2.get(f"{self.url}{POST}/{id_}/result", timeout=PATIENCE)
        assert answer.status_code == 200, answer.text
        return answer.content

    def measured(self, container, name):
        """A figure of a worker's /metrics, over all labels."""
        text = inside(
            container, "import urllib.request as w; print(w.urlopen('http://127.0.0.1:9100').read().decode())"
        )
        return sum(float(line.rpartition(" ")[2]) for line in text.splitlines() if line.startswith(name))


@pytest.fixture(scope="session")
def containers():
    """This module: test modules can't import it."""
    return sys.modules[__name__]


@pytest.fixture(scope="session")
def engine():
    if os.environ.get("CIIR_TEST_CONTAINERS") != "1":
        pytest.skip("builds an image and takes minutes: set CIIR_TEST_CONTAINERS=1 where a Docker engine is present")
    if not works("docker", "info"):
        pytest.skip("no Docker engine answers to `docker info`")


@pytest.fixture(scope="session")
def compose(engine):
    """The words that compose is called by: the engine's own, else the older program."""
    for command in (["docker", "compose"], ["docker-compose"]):
        if works(*command, "version"):
            return command
    return pytest.skip("neither `docker compose` nor `docker-compose` is here")


@pytest.fixture(scope="session")
def image(engine):
    run("docker", "build", "--network", "host", "--tag", IMAGE, ROOT)
    return IMAGE


@pytest.fixture(scope="session")
def redis(engine):
    """Where the official image can't be had, one made of Debian's Redis takes its name."""
    if not works("docker", "image", "inspect", REDIS) and not works("docker", "pull", REDIS):
        dockerfile = Path(__file__).with_name("redis.Dockerfile").read_text()
        run("docker", "build", "--network", "host", "--tag", REDIS, "-", input=dockerfile)
    return REDIS


@pytest.fixture(scope="module")
def stack(compose, image, redis, tmp_path_factory):
    made = Stack(compose, tmp_path_factory.mktemp("stack"))
    try:
        made.up()
        yield made
    except AssertionError:
        print(made("logs", "--no-color"))
        raise
    finally:
        made("down", "--volumes", "--timeout", "40")
