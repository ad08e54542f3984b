"""Jobs, the pool of worker processes and what brings them together, opened, drained and closed as one."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from ciir.errors import NotReady, QueueUnavailable
from ciir.service.jobs.jobs import Jobs
from ciir.service.jobs.workers.consumer import Consumer
from ciir.service.metrics import CountingPool

if TYPE_CHECKING:
    from ciir.service.jobs.workers.pool import Pool
    from ciir.service.metrics import Metrics
    from ciir.service.settings import Settings


class Engine:
    """What `ciir serve` and `ciir worker` share. With `settings.workers` of 0 there are jobs and nobody who does them
    here.
    """

    def __init__(self, settings: Settings, metrics: Metrics, pool: Pool | None = None) -> None:
        """Opens the queue; raises `InvalidOption`. Nothing runs yet. `pool`: a new one where None is given."""
        self.jobs = Jobs(settings)
        self.metrics = metrics
        self._settings = settings
        self._pool = pool or _pool(settings)
        self._consumer = (
            Consumer(self.jobs, CountingPool(self._pool, metrics), settings.workers) if self._pool is not None else None
        )
        self._was_ready = False
        self._draining = threading.Event()
        self._changing = threading.Lock()
        metrics.workers.set_function(self._pool.count_ready if self._pool is not None else lambda: 0)

    def start(self) -> None:
        """Begins to take jobs off the queue, and to start worker processes; nothing where it was drained before."""
        with self._changing:  # a signal may have it drained from another thread meanwhile
            if self._pool is not None and self._consumer is not None:
                self._pool.start()
                self._consumer.start()

    def check_accepting(self) -> None:
        """Raises `NotReady` before the first worker was ready, and from `drain` on.

        Not where workers are replaced later: jobs wait for that in the queue.
        """
        if self._draining.is_set():
            raise NotReady("the server is stopping; try again in a second, another one may answer")
        if self._pool is not None and not (self._was_ready or self._pool.is_ready()):
            raise NotReady("the models are being loaded; try again in a second (where that fails the log says so)")
        self._was_ready = True

    def check_ready(self) -> None:
        """Raises `NotReady` unless requests are taken and a worker answers, or `QueueUnavailable` without a queue."""
        self.check_accepting()
        if self._pool is not None and not self._pool.is_ready():
            raise NotReady("no worker process answers; new ones are being started, try again in a second")
        self.jobs.waiting()

    def update_gauges(self) -> None:
        """Brings the queue's figures in `metrics` up to date; those of the process itself always are."""
        try:
            waiting, running = self.jobs.waiting(), self.jobs.running()
        except QueueUnavailable:
            self.metrics.queue_up.set(0)
            return
        self.metrics.queue_up.set(1)
        self.metrics.waiting.set(waiting)
        self.metrics.running.set(running)

    def stop_accepting(self) -> None:
        """From now on nothing new is admitted: `check_accepting` raises."""
        self._draining.set()

    def drain(self) -> None:
        """Takes nothing more off the queue; what runs is finished within `drain_seconds` or put back. Blocks."""
        self.stop_accepting()
        with self._changing:
            if self._consumer is not None:
                self._consumer.stop(self._settings.drain_seconds)
                self._consumer = None

    def close(self) -> None:
        """Drains, and ends the worker processes."""
        self.drain()
        if self._pool is not None:
            self._pool.close()
        self.jobs.close()


def _pool(settings: Settings) -> Pool | None:
    if not settings.workers:
        return None
    from ciir.service.jobs.workers.pool import Pool

    return Pool(settings)
