"""Prometheus metrics of a server or a worker."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest

from ciir.service.jobs.job import Problem

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable, Mapping
    from typing import Any, Protocol

    from ciir.service.jobs.job import Result
    from ciir.service.jobs.workers.task import Task

    class Runs(Protocol):
        """A pool of worker processes, or a wrapper of one."""

        def run(
            self, work: Task, *, progress: Callable[[dict[str, Any]], None], cancelled: threading.Event
        ) -> Result | Problem:
            """Runs `work` and returns its outcome."""
            ...


_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60, 300)
_SKIPPED = ("uniform", "repeated")


class Metrics:
    """The metrics of one process, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        counter = partial(Counter, registry=self.registry)
        gauge = partial(Gauge, registry=self.registry)
        histogram = partial(Histogram, registry=self.registry, buckets=_SECONDS)
        self.requests = counter("ciir_http_requests", "Requests answered", ("method", "route", "status"))
        self.latency = histogram(
            "ciir_http_request_seconds", "From the head of a request to the end of its response", ("method", "route")
        )
        self.received = counter("ciir_http_received_bytes", "Bytes of request bodies")
        self.sent = counter("ciir_http_sent_bytes", "Bytes of response bodies")
        self.submitted = counter(
            "ciir_jobs_submitted", "Reconstructions requested; kind: accepted, known or refused", ("kind",)
        )
        self.waiting = gauge("ciir_queue_waiting", "Waiting jobs")
        self.running = gauge("ciir_queue_running", "Running jobs, on all machines")
        self.queue_up = gauge("ciir_queue_up", "1 if the queue can be reached, else 0")
        self.workers = gauge("ciir_workers", "Worker processes of this machine that have loaded the models")
        self.busy = gauge("ciir_workers_busy", "Worker processes of this machine that run a job")
        self.ended = counter(
            "ciir_jobs_ended", "Reconstructions ended; status: 200, a problem's, or an exception's name", ("status",)
        )
        self.seconds = histogram("ciir_job_seconds", "Of a worker process per reconstruction")
        self.stages = counter("ciir_stage_seconds", "Seconds of finished reconstructions by stage", ("stage",))
        self.written = counter("ciir_result_bytes", "Bytes of the results of finished reconstructions")
        self.pixels = counter("ciir_model_pixels", "Input pixels of models")
        self.skipped = counter("ciir_model_pixels_skipped", "Input pixels that needed no model, by reason", ("reason",))

    def text(self) -> bytes:
        """All metrics in Prometheus' text format."""
        return generate_latest(self.registry)

    def count_result(self, result: Result) -> None:
        """Adds the stages, bytes and pixels of a finished reconstruction."""
        self.written.inc(result.size)
        for stage, milliseconds in result.report["timings_ms"].items():
            self.stages.labels(stage).inc(milliseconds / 1000)
        skipped: Mapping[str, float] | None = result.report["plan"]["skipped"]
        if skipped is not None and "pixels" in skipped:  # a mesh has `culled` even where no model ran
            self.pixels.inc(skipped["pixels"])
            for reason in _SKIPPED:
                self.skipped.labels(reason).inc(round(skipped["pixels"] * skipped[reason]))


class CountingPool:
    """A pool that counts its work in `metrics`."""

    def __init__(self, pool: Runs, metrics: Metrics) -> None:
        self._pool, self._metrics = pool, metrics

    def run(
        self, work: Task, *, progress: Callable[[dict[str, Any]], None], cancelled: threading.Event
    ) -> Result | Problem:
        """Runs `work` as the pool does."""
        begun = time.perf_counter()
        status = "?"
        self._metrics.busy.inc()
        try:
            outcome = self._pool.run(work, progress=progress, cancelled=cancelled)
        except BaseException as error:
            status = type(error).__name__
            raise
        else:
            status = str(outcome.status) if isinstance(outcome, Problem) else "200"
        finally:
            self._metrics.busy.dec()
            self._metrics.seconds.observe(time.perf_counter() - begun)
            self._metrics.ended.labels(status).inc()
        if not isinstance(outcome, Problem):
            self._metrics.count_result(outcome)
        return outcome
