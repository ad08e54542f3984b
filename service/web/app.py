"""The HTTP API, put together. Nothing is decoded, rendered or upscaled in this process: see `service.jobs.engine`."""

from __future__ import annotations

from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING

from anyio import to_thread
from fastapi import Depends, FastAPI, Request, Response
from starlette.middleware.cors import CORSMiddleware

from ciir.service.jobs.engine import Engine
from ciir.service.metrics import Metrics
from ciir.service.settings import Settings
from ciir.service.web import problems
from ciir.service.web.middleware.body_limit import BodyLimit
from ciir.service.web.middleware.keys import guard
from ciir.service.web.middleware.observe import QUIET, Observe
from ciir.service.web.routes import docs, operations, reconstructions, results
from ciir.service.web.routes.common import Parts

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from starlette.datastructures import Headers

EXPOSED = (
    "Content-Location",
    "ETag",
    "Location",
    "Preference-Applied",
    "Retry-After",
    "Server-Timing",
    "X-Reconstruction-Id",
    "X-Request-Id",
)
"""Headers that scripts of other origins may read, where those are let in."""


def create_app(settings: Settings | None = None, engine: Engine | None = None) -> FastAPI:
    """The application; `settings` come from the environment where None is given, and make the engine.

    With the application's lifespan the engine starts, drains and closes. `app.state.parts` holds what the routes share.
    """
    settings = settings or Settings()
    metrics = engine.metrics if engine is not None else Metrics()
    parts = Parts(settings, engine or Engine(settings, metrics), metrics)
    app = FastAPI(
        title="ciir",
        description="Computational integral imaging reconstruction",
        version=version("ciir"),
        docs_url=None,
        redoc_url=None,
        lifespan=_lifespan,
        # Exports where OTEL_EXPORTER_OTLP_ENDPOINT is set.
        telemetry={"auto_configure": True, "exclude": lambda scope: scope.get("path") in QUIET},
    )
    app.openapi_version = "3.0.3"  # the newest that the Swagger UI of swagger-ui-bundle shows
    app.state.parts = parts
    app.add_middleware(BodyLimit, limits={results.ROOT: settings.max_body_bytes}, seconds=settings.body_seconds)
    if settings.cors_origins:
        app.add_middleware(
            _Cors,
            allow_origins=settings.cors_origins,
            allow_methods=("GET", "POST", "DELETE"),
            allow_headers=("Authorization", "X-API-Key", "Prefer", "If-None-Match", "Last-Event-ID", "X-Request-Id"),
            expose_headers=EXPOSED,
        )
    app.add_middleware(Observe, metrics=metrics)
    problems.install(app)
    app.add_exception_handler(reconstructions.NoNews, _no_news)
    key = Depends(guard(key.get_secret_value() for key in settings.api_keys))
    app.include_router(operations.health(parts))
    app.include_router(operations.router(parts), dependencies=[key])
    app.include_router(reconstructions.router(parts), dependencies=[key])
    docs.add(app)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    parts: Parts = app.state.parts
    await to_thread.run_sync(parts.engine.start)
    yield
    parts.stopped.set()
    await to_thread.run_sync(parts.engine.close)


class _Cors(CORSMiddleware):
    """Starlette's, which refuses in plain text, made to refuse with a problem."""

    def preflight_response(self, request_headers: Headers) -> Response:
        """To what a browser asks before a script of another origin may."""
        answer = super().preflight_response(request_headers)
        if answer.status_code == 200:
            return answer
        headers = {name: value for name, value in answer.headers.items() if not name.startswith("content-")}
        fault = bytes(answer.body).decode()
        detail = f"{fault}; ask from an origin that CIIR_CORS_ORIGINS names, with a method and headers that /docs names"
        return problems.problem("", answer.status_code, detail, headers=headers)


async def _no_news(request: Request, error: Exception) -> Response:  # noqa: ARG001
    return Response(status_code=204)
