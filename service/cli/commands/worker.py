"""`ciir worker`: runs jobs that a web process accepts."""

from __future__ import annotations

import logging
import signal
import threading
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.service.cli import common

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator
    from types import FrameType

    from ciir.service.metrics import Metrics

LOOK_SECONDS = 0.5
"""Interval at which the main thread wakes up. Python runs signal handlers only there, between two instructions."""
_log = logging.getLogger("ciir")


def run(args: argparse.Namespace) -> None:  # noqa: ARG001 - all commands share this signature
    """Runs jobs until SIGTERM or Ctrl-C. Running jobs then finish or go back to the queue."""
    from ciir.models import catalogue
    from ciir.service.jobs.engine import Engine
    from ciir.service.metrics import Metrics

    found = common.start_service()
    if not found.workers:
        raise InvalidOption("CIIR_WORKERS: 0 leaves a worker without processes; set 1 or more, or unset it")
    catalogue.list_entries()  # stops the command early if a folder in CIIR_MODELS can't be used
    stop = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature is Python's
        stop.set()

    metrics = Metrics(of_web=False)
    engine = Engine(found, metrics)
    with ExitStack() as rest:
        for number in (signal.SIGTERM, signal.SIGINT):
            rest.callback(signal.signal, number, signal.signal(number, end))
        rest.callback(engine.close)
        if found.metrics_port:
            rest.enter_context(_showing(metrics, found.metrics_port))
        _log.info(engine.describe_place())
        engine.start()
        processes = "worker process takes" if found.workers == 1 else "worker processes take"
        _log.info("%d %s jobs", found.workers, processes)
        while not stop.wait(LOOK_SECONDS):
            pass
        _log.info("stopping: running jobs have %g s to finish", found.drain_seconds)


@contextmanager
def _showing(metrics: Metrics, port: int) -> Iterator[None]:
    """Serves the metrics at /metrics of that port, on all addresses. Raises `InvalidOption` if the port is taken."""
    from prometheus_client import start_http_server

    try:
        server, thread = start_http_server(port, registry=metrics.registry)
    except OSError as error:
        raise InvalidOption(f"CIIR_METRICS_PORT: {port}: {error.strerror}; set another") from error
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
