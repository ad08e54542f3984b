"""Routes for operators, and the list of models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from anyio import to_thread
from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST

from ciir.service import listing
from ciir.service.pipeline.options import AUTO_MODEL
from ciir.service.web.routes import openapi

if TYPE_CHECKING:
    from ciir.service.web.routes.state import ServiceState


def make_health_router(state: ServiceState) -> APIRouter:
    """Makes the health checks for load balancers, which need no API key."""
    routes = APIRouter()

    @routes.head("/healthz", include_in_schema=False)
    @routes.get("/healthz", summary="Alive: the process responds", responses=openapi.describe_errors())
    async def healthz() -> dict[str, str]:
        return {"status": "alive"}

    @routes.head("/readyz", include_in_schema=False)
    @routes.get(
        "/readyz",
        summary="Ready: a worker has loaded its models, the queue can be reached, and the server is not stopping",
        responses=openapi.describe_errors(503),
    )
    async def readyz() -> dict[str, str]:
        await to_thread.run_sync(state.engine.check_ready)
        return {"status": "ready"}

    return routes


def make_router(state: ServiceState) -> APIRouter:
    """Makes the routes that need an API key if the server has any."""
    routes = APIRouter()

    @routes.get(
        "/v1/models",
        summary="List of models with their cards",
        description=f"`default` marks the default for single pictures. Without the option `model`: {AUTO_MODEL}.",
        responses=openapi.describe_errors(401),
    )
    def list_models() -> list[dict[str, Any]]:
        return listing.list_models()

    @routes.get(
        "/metrics",
        summary="Metrics for Prometheus",
        response_class=Response,
        responses=openapi.describe_response(200, "Prometheus' text format", "text/plain")
        | openapi.describe_errors(401),
    )
    def metrics() -> Response:
        state.engine.update_gauges()
        return Response(state.metrics.text(), media_type=CONTENT_TYPE_LATEST)

    return routes
