"""Builds the image and runs the compose file's services on a real Docker engine.

This takes minutes and needs a network for the build, so it runs only on request: `CIIR_TEST_CONTAINERS=1 python -m
pytest tests/containers`.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.containers.docker import IMAGE, REDIS, Stack, run, succeeds
from tests.support.paths import ROOT


@pytest.fixture(scope="session")
def engine():
    if os.environ.get("CIIR_TEST_CONTAINERS") != "1":
        pytest.skip("builds an image and takes minutes: set CIIR_TEST_CONTAINERS=1 where a Docker engine is present")
    if not succeeds("docker", "info"):
        pytest.skip("no Docker engine answers to `docker info`")


@pytest.fixture(scope="session")
def compose(engine):
    """Returns the command of compose: the engine's own, or the older program."""
    for command in (["docker", "compose"], ["docker-compose"]):
        if succeeds(*command, "version"):
            return command
    return pytest.skip("neither `docker compose` nor `docker-compose` is here")


@pytest.fixture(scope="session")
def image(engine):
    run("docker", "build", "--network", "host", "--tag", IMAGE, ROOT)
    return IMAGE


@pytest.fixture(scope="session")
def redis(engine):
    """Returns the official image, or if it can't be pulled, one with Debian's Redis under the same name."""
    if not succeeds("docker", "image", "inspect", REDIS) and not succeeds("docker", "pull", REDIS):
        dockerfile = Path(__file__).with_name("redis.Dockerfile").read_text()
        run("docker", "build", "--network", "host", "--tag", REDIS, "-", input=dockerfile)
    return REDIS


@pytest.fixture(scope="module")
def stack(compose, image, redis, tmp_path_factory):
    services = Stack(compose, tmp_path_factory.mktemp("stack"))
    try:
        services.up()
        yield services
    except AssertionError:
        print(services("logs", "--no-color"))
        raise
    finally:
        services("down", "--volumes", "--timeout", "40")
