"""Prometheus metrics of a server or a worker."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60, 300)


def _bind_types(registry: CollectorRegistry | None) -> tuple[partial[Counter], partial[Gauge], partial[Histogram]]:
    """Returns the types of metrics, made in `registry`, or in none so that they are not exported."""
    return (
        partial(Counter, registry=registry),
        partial(Gauge, registry=registry),
        partial(Histogram, registry=registry, buckets=_SECONDS),
    )


class Metrics:
    """The metrics of one process, in their own registry."""

    def __init__(self, *, of_web: bool = True) -> None:
        """`of_web`: whether the process serves HTTP. Otherwise metrics of requests and of the queue are left out.

        A worker's health check reads its metrics, so they must not depend on the queue's server.
        """
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        counter, gauge, histogram = _bind_types(self.registry if of_web else None)
        self.requests = counter("ciir_http_requests", "Requests answered", ("method", "route", "status"))
        self.latency = histogram(
            "ciir_http_request_seconds", "From the head of a request to the end of its response", ("method", "route")
        )
        self.received = counter("ciir_http_received_bytes", "Bytes of request bodies")
        self.sent = counter("ciir_http_sent_bytes", "Bytes of response bodies")
        self.submitted = counter(
            "ciir_jobs_submitted", "Jobs requested; kind: accepted (new), known or refused", ("kind",)
        )
        self.waiting = gauge("ciir_queue_waiting", "Waiting jobs")
        self.jobs = gauge("ciir_queue_jobs", "Jobs on all machines; state: queued or running", ("lane", "state"))
        self.oldest = gauge(
            "ciir_queue_oldest_seconds", "Time of the job that has waited, or has run, the longest", ("lane", "state")
        )
        self.consumers = gauge("ciir_queue_consumers", "Live processes on all machines that take jobs from the queue")
        self.queue_up = gauge("ciir_queue_up", "1 if the queue can be reached, else 0")
        counter, gauge, histogram = _bind_types(self.registry)
        self.workers = gauge("ciir_workers", "Worker processes of this machine that have loaded the models")
        self.busy = gauge("ciir_workers_busy", "Worker processes of this machine that are running a job")
        self.ended = counter(
            "ciir_jobs_ended", "Jobs ended; status: 200, a problem's, or an exception's name", ("status",)
        )
        self.seconds = histogram("ciir_job_seconds", "Time of a worker process per job", ("kind",))
        self.stages = counter("ciir_stage_seconds", "Seconds of finished jobs by stage", ("stage",))
        self.written = counter("ciir_result_bytes", "Bytes of the results of finished jobs")
        self.pixels = counter("ciir_model_pixels", "Input pixels of models")
        self.skipped = counter("ciir_model_pixels_skipped", "Input pixels that needed no model")

    def text(self) -> bytes:
        """Returns all metrics in Prometheus' text format."""
        return generate_latest(self.registry)

    def count_result(self, size: int, report: Mapping[str, Any]) -> None:
        """Adds the stages, bytes and pixels of a finished job. `size`: bytes of its result."""
        self.written.inc(size)
        for stage, milliseconds in report["timings_ms"].items():
            if stage != "total":  # it contains the others
                self.stages.labels(stage).inc(milliseconds / 1000)
        skipped: Mapping[str, float] | None = report.get("plan", report).get("skipped")
        if skipped is not None and "pixels" in skipped:  # a mesh has `culled` even if no model ran
            self.pixels.inc(skipped["pixels"])
            self.skipped.inc(round(skipped["pixels"] * skipped["uniform"]))
