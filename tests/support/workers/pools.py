"""Pools of worker processes that start without warm-up, and tasks for them."""

import threading

from ciir.service.jobs.workers.task import Hooks

COLD = "tests.support.workers.cold_worker"
FAST = {"lenses": "12x10", "pixels": "3x3", "model": "none", "backend": "raytrace"}
LONG = {"lenses": "400x400", "pixels": "15x15", "views": "all", "model": "none", "backend": "raytrace"}
"""Options of a job of about ten seconds, so that a test can act meanwhile."""


def run(pool, task, progress=lambda _: None, cancelled=None, begun=lambda _: None):
    return pool.run(task, Hooks(begun, progress, cancelled or threading.Event()))
