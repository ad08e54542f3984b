"""The compose file's cluster for `ciir batch`: results, and what happens when a worker or the scheduler dies."""

import csv
import os
import sys

import numpy as np
import pytest

from tests.containers import docker
from tests.support.paths import ROOT

ARRAYS = 24
BATCH = ("run", "--rm", "-T", "batch", "/batch/in", "-o", "/batch/out", "--name", "{path}.npz")
OPTIONS = ("--lenses", "60x60", "--views", "all")


@pytest.fixture(scope="module")
def cluster(compose, image, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cluster")
    (folder / "batch" / "in").mkdir(parents=True)
    for seed in range(ARRAYS):
        (folder / "batch" / "in" / f"{seed}.png").write_bytes(docker.make_noise(300, 300, seed)[1])
    owner = {"BATCH_USER": f"{os.getuid()}:{os.getgid()}"}
    services = docker.Stack(compose, folder, owner)
    try:
        services("--profile", "cluster", "up", "--detach", "--no-build", "scheduler", "batch-worker")
        yield services
    except AssertionError:
        print(services("--profile", "cluster", "logs", "--no-color"))
        raise
    finally:
        services("--profile", "cluster", "--profile", "batch", "down", "--volumes", "--timeout", "10")


def read_statuses(cluster):
    with (cluster.folder / "batch" / "out" / "summary.csv").open() as file:
        return [row["status"] for row in csv.DictReader(file)]


def test_a_batch_survives_its_workers_and_its_scheduler(cluster, tmp_path):
    out = cluster.folder / "batch" / "out"
    with cluster.start(*BATCH, *OPTIONS) as batch:
        docker.wait_for(lambda: len(list(out.glob("*.npz"))) >= 2, "the first outputs")
        (worker,) = cluster.containers("batch-worker")
        docker.run("docker", "restart", "--time", "0", worker)
        docker.wait_for(lambda: len(list(out.glob("*.npz"))) >= 6, "more outputs")
        (scheduler,) = cluster.containers("scheduler")
        docker.run("docker", "restart", "--time", "0", scheduler)
        errors = batch.communicate(timeout=300)[1]
    assert batch.returncode == 0, errors
    assert read_statuses(cluster) == ["done"] * ARRAYS
    command = [sys.executable, "-m", "ciir", "reconstruct", cluster.folder / "batch" / "in" / "7.png", "-o", "7.npz"]
    docker.run(*command, *OPTIONS, cwd=tmp_path, env=os.environ | {"PYTHONPATH": ROOT})
    found, expected = (np.load(folder / "7.npz")["views"] for folder in (out, tmp_path))
    assert np.array_equal(found, expected)


def test_a_second_run_keeps_what_is_done(cluster):
    cluster(*BATCH, *OPTIONS)
    assert read_statuses(cluster) == ["kept"] * ARRAYS
