"""`docker compose up`: results, and what happens to jobs when parts of it die."""

import io
import os
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from tests.containers import docker
from tests.support.paths import ROOT

LONG = {"lenses": "120x120", "views": "all", "model": "paper", "format": "npz"}
"""25 views by the slowest network: seconds."""


def make_long(seed):
    return docker.make_noise(600, 600, seed)[1]


def list_processes(container):
    """Ids of a container's worker processes: what its first process has spawned, but for what cleans up after them."""
    program = """
import pathlib
threads = pathlib.Path("/proc/1/task").glob("*/children")
names = [name for thread in threads for name in thread.read_text().split()]
print(*(name for name in names if "resource_tracker" not in pathlib.Path("/proc", name, "cmdline").read_text()))
"""
    found = docker.run_inside(container, program).split()
    assert len(found) == 2  # CIIR_WORKERS
    return found


def test_results_are_the_command_lines(stack, tmp_path):
    _, png = docker.make_noise(60, 90, seed=1)
    (tmp_path / "eia.png").write_bytes(png)
    command = ["-m", "ciir", "reconstruct", "eia.png", "--lenses", "12x18", "--views", "cross", "-o", "out"]
    docker.run(sys.executable, *command, cwd=tmp_path, env=os.environ | {"PYTHONPATH": ROOT})
    answer = docker.post(stack.url, png, lenses="12x18", views="cross", format="zip")
    assert answer.status_code == 200, answer.text
    with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
        names = [name for name in archive.namelist() if name.endswith(".png")]
        assert len(names) == 5
        for name in names:
            expected = decode((tmp_path / "out" / name).read_bytes(), name=name)
            assert np.array_equal(decode(archive.read(name), name=name), expected)


def test_three_workers_share_the_work(stack):
    stack.up(workers=3)
    workers = stack.containers("worker")
    assert len(workers) == 3
    seed = 100

    def all_took_part():
        nonlocal seed
        seed += 6
        pictures = [docker.make_noise(240, 240, seed + index)[1] for index in range(6)]
        with ThreadPoolExecutor(6) as pool:
            for answer in pool.map(lambda png: docker.post(stack.url, png, lenses="48x48"), pictures):
                assert answer.status_code == 200, answer.text
        return all(stack.read_metric(worker, "ciir_jobs_ended_total") for worker in workers)

    docker.wait_for(all_took_part, "each worker has done a job")


def test_a_worker_container_is_killed(stack):
    stack.up(workers=2)
    id_ = stack.submit(make_long(seed=2), **LONG)
    worker = docker.wait_for(
        lambda: next((one for one in stack.containers("worker") if stack.read_metric(one, "ciir_workers_busy")), None),
        "a worker has begun",
    )
    docker.run("docker", "kill", worker)
    assert stack.wait_until_done(id_)["attempts"] == 2
    assert np.load(io.BytesIO(stack.result(id_)))["views"].shape == (25, 240, 240, 3)


def test_worker_processes_are_killed(stack):
    stack.up(workers=1)
    id_ = stack.submit(make_long(seed=3), **LONG)
    (worker,) = stack.containers("worker")
    docker.wait_for(lambda: stack.status(id_)["progress"], "the job is begun")
    for process in list_processes(worker):
        docker.run_inside(worker, f"import os; os.kill({process}, 9)")
    assert stack.wait_until_done(id_)["attempts"] == 2
    assert stack.containers("worker") == [worker]


def test_the_web_container_is_killed_with_jobs_waiting(stack):
    stack.up(workers=1)
    ids = [stack.submit(make_long(seed), **LONG) for seed in (5, 6)]
    ids += [stack.submit(docker.make_noise(24, 36, seed)[1], lenses="6x9") for seed in range(10, 30)]
    (web,) = stack.containers("web")
    docker.run("docker", "kill", web)
    docker.run("docker", "start", web)
    docker.wait_for(lambda: docker.is_ready(stack.url), "the web process is ready again")
    for id_ in ids:
        assert stack.wait_until_done(id_)["attempts"] == 1


@pytest.mark.parametrize("way", ["restart", "kill"])
def test_redis_goes_and_comes_back(stack, way):
    stack.up(workers=1)
    first = 40 if way == "restart" else 60
    ids = [stack.submit(make_long(seed), **LONG) for seed in (first, first + 1)]
    ids += [stack.submit(docker.make_noise(24, 36, seed)[1], lenses="6x9") for seed in range(first + 2, first + 12)]
    (redis,) = stack.containers("redis")
    docker.run("docker", way, redis)
    if way == "kill":
        docker.wait_for(lambda: not docker.is_ready(stack.url), "the web process says that it isn't ready")
        docker.run("docker", "start", redis)
    docker.wait_for(lambda: docker.is_ready(stack.url), "the web process is ready again")
    for id_ in ids:
        stack.wait_until_done(id_)


def test_workers_reach_nothing_outside(stack):
    """Their container's networks lead nowhere else, and the processes that read inputs can't even open a socket."""
    (worker, *_) = stack.containers("worker")
    for network in docker.describe(worker)["NetworkSettings"]["Networks"].values():
        assert docker.describe(network["NetworkID"])["Internal"]
    look = "print(next(l for l in open('/proc/{}/status') if l.startswith('Seccomp_filters')).split()[1])"
    engines = int(docker.run_inside(worker, look.format(1)))
    for process in list_processes(worker):
        assert int(docker.run_inside(worker, look.format(process))) == engines + 1


def test_the_demo_leaves_pictures(stack):
    checkout = stack.folder / "docker-compose.yml"
    if os.geteuid() == 0:
        os.chown(checkout, 12345, 12345)
    stack("run", "--rm", "demo")
    left = stack.folder / "demo-out"
    assert {path.name for path in left.iterdir()} >= {"eia.png", "view_02_02.png", "report.json"}
    assert decode((left / "view_02_02.png").read_bytes(), name="x").shape == (200, 200, 3)
    assert {path.stat().st_uid for path in (left, *left.iterdir())} == {checkout.stat().st_uid}


def test_all_of_it_stops_on_sigterm(stack):
    stack.up(workers=1)
    ids = [stack.submit(make_long(seed), **LONG) for seed in (80, 81, 82)]
    (worker,) = stack.containers("worker")
    docker.wait_for(lambda: stack.read_metric(worker, "ciir_workers_busy"), "a job runs")
    started = [container for service in ("web", "worker") for container in stack.containers(service)]
    stack("stop", "--timeout", "60")
    assert [docker.inspect(container, "{{.State.ExitCode}}") for container in started] == ["0", "0"]
    stack.up(workers=1)
    for id_ in ids:
        stack.wait_until_done(id_)
