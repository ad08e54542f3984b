"""The routes for whoever runs the service, and the list of models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from anyio import to_thread
from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST

from ciir.service import listing
from ciir.service.pipeline.options import AUTO_TAKES
from ciir.service.web import openapi

if TYPE_CHECKING:
    from ciir.service.web.routes.state import ServiceState


def make_health_router(state: ServiceState) -> APIRouter:
    """What load balancers ask: open to everybody, and nothing that it tells is worth hiding."""
    routes = APIRouter()

    @routes.head("/healthz", include_in_schema=False)
    @routes.get("/healthz", summary="Alive: the process answers", responses=openapi.describe_errors())
    async def healthz() -> dict[str, str]:
        return {"status": "alive"}

    @routes.head("/readyz", include_in_schema=False)
    @routes.get(
        "/readyz",
        summary="Ready: a worker answers with its models loaded, the queue is there, and the server isn't stopping",
        responses=openapi.describe_errors(503),
    )
    async def readyz() -> dict[str, str]:
        await to_thread.run_sync(state.engine.check_ready)
        return {"status": "ready"}

    return routes


def make_router(state: ServiceState) -> APIRouter:
    """What needs a key, where there are keys."""
    routes = APIRouter()

    @routes.get(
        "/v1/models",
        summary="The models that can be named, with their cards",
        description=f"`default` is the one for single pictures. Where no model is named: {AUTO_TAKES}.",
        responses=openapi.describe_errors(401),
    )
    def list_models() -> list[dict[str, Any]]:
        return listing.list_models()

    @routes.get(
        "/metrics",
        summary="Counters for Prometheus",
        response_class=Response,
        responses=openapi.describe_response(200, "Prometheus' text format", "text/plain")
        | openapi.describe_errors(401),
    )
    def metrics() -> Response:
        state.engine.update_gauges()
        return Response(state.metrics.text(), media_type=CONTENT_TYPE_LATEST)

    return routes
