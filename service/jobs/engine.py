"""The jobs, the consumer and the worker processes of one server, started, drained and closed together."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from ciir.errors import NotReady, QueueUnavailable
from ciir.service.jobs.jobs import Jobs
from ciir.service.jobs.workers.consumer import Consumer
from ciir.service.jobs.workers.counting_pool import CountingPool
from ciir.service.jobs.workers.recovery import DEAD_SECONDS, date_heartbeats
from ciir.service.settings import hide_secrets

if TYPE_CHECKING:
    from ciir.service.jobs.workers.pool import Pool
    from ciir.service.jobs.workers.recovery import Heartbeats
    from ciir.service.metrics import Metrics
    from ciir.service.settings import Settings

STOPPING = "the server is stopping; try again in a second, another one may answer"
"""The error for new work, and for uploads that the stop interrupts."""


class Engine:
    """The part shared by `ciir serve` and `ciir worker`. If `settings.workers` is 0, it only stores jobs."""

    def __init__(self, settings: Settings, metrics: Metrics, pool: Pool | None = None) -> None:
        """Opens the queue and starts nothing. Raises `InvalidOption`. `pool`: created if it is None."""
        self.jobs = Jobs(settings)
        self.metrics = metrics
        self._settings = settings
        if pool is None and settings.workers:
            from ciir.service.jobs.workers.pool import Pool

            pool = Pool(settings)
        self._pool = pool
        self._consumer = (
            Consumer(self.jobs, CountingPool(self._pool, metrics), settings.workers) if self._pool is not None else None
        )
        self._was_ready = False
        self._heartbeats: Heartbeats = {}
        self._draining = threading.Event()
        self._changing = threading.Lock()
        metrics.workers.set_function(self._pool.count_ready if self._pool is not None else lambda: 0)

    def describe_place(self) -> str:
        """Says where jobs and files are, without passwords, and how many other processes take jobs from there."""
        queue = hide_secrets(self._settings.queue) or self.jobs.folder
        files = hide_secrets(self._settings.files) or self.jobs.folder / "files"
        others = self._consumer.count_others() if self._consumer is not None else 0
        shared = f"; other processes on this machine that take these jobs too: {others}" if others else ""
        return f"jobs are in {queue}, inputs and results in {files}{shared}"

    def start(self) -> None:
        """Starts the worker processes and the consumer, unless it was drained before."""
        with self._changing:  # a signal may call `drain` in another thread meanwhile
            if self._pool is not None and self._consumer is not None:
                self._pool.start()
                self._consumer.start()

    def check_accepting(self) -> None:
        """Raises `NotReady` until the first worker is ready, and after `stop_accepting`.

        It doesn't raise while workers are replaced later: jobs then wait in the queue.
        """
        if self._draining.is_set():
            raise NotReady(STOPPING)
        if self._pool is not None and not (self._was_ready or self._pool.is_ready()):
            raise NotReady(self._describe_start("the models are being loaded; try again in a second"))
        self._was_ready = True

    def check_ready(self) -> None:
        """Raises `NotReady` unless a worker can take new jobs, and `QueueUnavailable` for disk, queue or files."""
        self.jobs.disk.check()  # first: a full disk may be why no worker is ready
        self.check_accepting()
        if self._pool is not None and not self._pool.is_ready():
            usual = "no worker process is ready; new ones are being started, try again in a second"
            raise NotReady(self._describe_start(usual))
        self.jobs.queue.check()
        self.jobs.count_waiting()
        self.jobs.files.check()

    def _describe_start(self, usual: str) -> str:
        """Says why no worker is ready: `usual` unless starting one failed."""
        return (self._pool.start_error if self._pool is not None else "") or usual

    def update_gauges(self) -> None:
        """Sets the gauges of the queue in `metrics`; all other metrics are always current."""
        try:
            waiting, ages = self.jobs.count_waiting(), self.jobs.measure_ages()
            heartbeats, now = self.jobs.queue.heartbeats.items(), time.monotonic()
        except QueueUnavailable:
            self._heartbeats = {}  # consumers couldn't send theirs either
            self.metrics.queue_up.set(0)
            return
        self.metrics.queue_up.set(1)
        self.metrics.waiting.set(waiting)
        self._heartbeats = date_heartbeats(heartbeats, self._heartbeats, now)
        self.metrics.consumers.set(sum(now - since < DEAD_SECONDS for _, since in self._heartbeats.values()))
        for (lane, state), seconds in ages.items():
            self.metrics.jobs.labels(lane, state).set(len(seconds))
            self.metrics.oldest.labels(lane, state).set(max(0.0, *seconds) if seconds else 0.0)

    def stop_accepting(self) -> None:
        """Makes `check_accepting` raise from now on."""
        self._draining.set()

    def drain(self) -> None:
        """Stops the consumer: running jobs finish within `drain_seconds` or return to the queue. Blocks."""
        self.stop_accepting()
        with self._changing:
            if self._consumer is not None:
                self._consumer.stop(self._settings.drain_seconds)
                self._consumer = None

    def close(self) -> None:
        """Drains, ends the worker processes and closes the queue."""
        self.drain()
        if self._pool is not None:
            self._pool.close()
        self.jobs.close()
