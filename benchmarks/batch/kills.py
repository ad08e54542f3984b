"""Runs a batch on a cluster whose workers are killed again and again, and whose scheduler is killed once."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any

from ciir.benchmarks.batch.cluster import Cluster, open_cluster

if TYPE_CHECKING:
    from pathlib import Path

WORKERS = 2
KILL_SECONDS = 5.0
SCHEDULER_KILL = 3
"""The number of the kill that hits the scheduler instead of a worker."""


def run_with_kills(inputs: Path, out: Path, options: list[str]) -> dict[str, Any]:
    """Runs the command on a cluster; returns what happened and the summary.

    A worker is killed every `KILL_SECONDS`, one after the other, and the scheduler once.
    """
    with open_cluster(WORKERS) as cluster:
        done = threading.Event()
        counts = {"workers killed": 0, "schedulers killed": 0}
        killer = threading.Thread(target=_kill, args=(cluster, done, counts), daemon=True)
        command = [sys.executable, "-m", "ciir", "batch", str(inputs), "-o", str(out), "--cluster", cluster.address]
        killer.start()
        ended = subprocess.run([*command, *options], check=False, capture_output=True, text=True)
        done.set()
        killer.join()
    summary = json.loads((out / "summary.json").read_bytes())
    return counts | {"exit status": ended.returncode, "errors": ended.stderr, "summary": summary}


def _kill(cluster: Cluster, done: threading.Event, counts: dict[str, int]) -> None:
    number = 0
    while not done.wait(KILL_SECONDS):
        number += 1
        if number == SCHEDULER_KILL:
            cluster.kill_scheduler()
            counts["schedulers killed"] += 1
        else:
            counts["workers killed"] += cluster.kill_worker(number % WORKERS)
