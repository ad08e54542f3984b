"""Routes for operators, and the list of models."""

from __future__ import annotations

from anyio import to_thread
from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST

from ciir.service import listing
from ciir.service.pipeline.options import AUTO_MODEL
from ciir.service.web.routes import openapi, schemas
from ciir.service.web.routes.state import State  # noqa: TC001 - FastAPI reads the annotations of routes

health = APIRouter()
"""Health checks, which need no API key."""
router = APIRouter()
"""Routes that need an API key if the server has any."""


@health.head("/healthz", include_in_schema=False)
@health.get(
    "/healthz",
    operation_id="getHealth",
    tags=["operation"],
    summary="Alive: the process responds",
    responses=openapi.describe_errors(),
)
async def healthz() -> dict[str, str]:
    """Answers as long as the process runs."""
    return {"status": "alive"}


@health.head("/readyz", include_in_schema=False)
@health.get(
    "/readyz",
    operation_id="getReadiness",
    tags=["operation"],
    summary="Ready: a worker has loaded its models, queue and files can be reached, and the server is not stopping",
    responses=openapi.describe_errors(503),
)
async def readyz(state: State) -> dict[str, str]:
    """Answers 503 with the reason if the server is not ready."""
    await to_thread.run_sync(state.engine.check_ready)
    return {"status": "ready"}


@router.head("/v1/models", include_in_schema=False)
@router.get(
    "/v1/models",
    operation_id="listModels",
    tags=["models"],
    summary="List of models with their cards",
    description=f"`default` marks the default for pictures. Without the option `model`: {AUTO_MODEL}.",
    response_class=JSONResponse,
    responses=openapi.describe_json(200, "the models", {"type": "array", "items": schemas.refer("Model")})
    | openapi.describe_errors(401),
)
def list_models() -> Response:
    """Lists the models of the catalogue."""
    return JSONResponse(listing.list_models())


@router.head("/metrics", include_in_schema=False)
@router.get(
    "/metrics",
    operation_id="getMetrics",
    tags=["operation"],
    summary="Metrics for Prometheus",
    response_class=Response,
    responses=openapi.describe_response(200, "Prometheus' text format", "text/plain") | openapi.describe_errors(401),
)
def metrics(state: State) -> Response:
    """Returns the metrics of this process and of the queue."""
    state.engine.update_gauges()
    return Response(state.engine.metrics.text(), media_type=CONTENT_TYPE_LATEST)
