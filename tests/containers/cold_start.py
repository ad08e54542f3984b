"""How long the compose file's services take from nothing to their first answer, and what they hold.

    docker build -t ciir . && python -m tests.containers.cold_start [--rounds 5]

Each round starts all containers of a new project with empty volumes, posts an elemental image array until it is
answered with a view, and takes everything down. Needs a Docker engine with compose.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import time

import httpx2
import numpy as np

from ciir.renderer.writers.pictures import encode_png
from tests.support.paths import ROOT

PROJECT, PORT = "ciir-bench", "18765"
URL = f"http://127.0.0.1:{PORT}/v1/reconstructions"
PATIENCE_SECONDS = 60


def cold_start(compose: list[str]) -> tuple[float, float, dict[str, int]]:
    """Seconds from `up` to the first result, those of them that `up` itself took, and MiB held by each service."""
    eia = encode_png(np.random.default_rng(0).integers(0, 255, (250, 250, 3), np.uint8))
    run(*compose, "down", "--volumes")
    begun = time.perf_counter()
    run(*compose, "up", "--detach", "--no-build")
    started = time.perf_counter()
    while not _answers(eia):
        if time.perf_counter() - started > PATIENCE_SECONDS:
            sys.exit(f"no answer within {PATIENCE_SECONDS} s:\n{run(*compose, 'logs')}")
        time.sleep(0.02)
    done = time.perf_counter()
    held = {service: _resident(run(*compose, "ps", "--quiet", service)) for service in ("web", "worker")}
    run(*compose, "down", "--volumes")
    return done - begun, started - begun, held


def _answers(eia: bytes) -> bool:
    """Whether a view comes back; a server that isn't there yet, or says so, is no answer."""
    try:
        answer = httpx2.post(URL, files={"file": ("eia.png", eia)}, data={"lenses": "50x50"}, timeout=PATIENCE_SECONDS)
    except httpx2.TransportError:
        return False
    if answer.status_code not in (200, 503):
        sys.exit(f"{answer.status_code}: {answer.text}")
    return answer.status_code == 200


def _resident(container: str) -> int:
    """MiB of all processes of a container, those that they share counted once for each."""
    program = "import pathlib; print(sum(int(line.split()[1]) for place in pathlib.Path('/proc').glob('[0-9]*/status') "
    program += "if place.parent.name != str(__import__('os').getpid()) for line in place.read_text().splitlines() "
    program += "if line.startswith('VmRSS')))"
    return int(run("docker", "exec", container, "python", "-c", program)) // 1024


def run(*command: str) -> str:
    """A command's output; ends this program where it fails."""
    environment = os.environ | {"CIIR_PORT": PORT}
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT, env=environment)  # noqa: S603 - our own
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: {done.stderr[-2000:]}")
    return done.stdout.strip()


def main() -> None:
    """Prints a line a round, and medians."""
    parser = argparse.ArgumentParser(prog="tests.containers.cold_start", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="cold starts (default 5)")
    rounds = parser.parse_args().rounds
    compose = ["docker-compose"] if shutil.which("docker-compose") else ["docker", "compose"]
    size = int(run("docker", "image", "inspect", "--format", "{{.Size}}", os.environ.get("CIIR_IMAGE", "ciir")))
    print(f"image: {size / 1e6:.0f} MB")
    found = []
    for _ in range(rounds):
        found.append(cold_start([*compose, "-p", PROJECT]))
        whole, up, held = found[-1]
        print(f"first answer {whole:.1f} s after `up` was called, {whole - up:.1f} s after it returned; MiB: {held}")
    print(
        f"medians of {rounds}: {statistics.median(whole for whole, _, _ in found):.1f} s after `up` was called, ",
        end="",
    )
    print(f"{statistics.median(whole - up for whole, up, _ in found):.1f} s after it returned")


if __name__ == "__main__":
    main()
