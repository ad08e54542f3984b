"""The HTTP application. Worker processes do all decoding, rendering and upscaling (see `service.jobs.engine`)."""

from __future__ import annotations

from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING

from anyio import to_thread
from fastapi import Depends, FastAPI, Request, Response
from starlette.middleware.cors import CORSMiddleware

from ciir.service.jobs.engine import Engine
from ciir.service.metrics import Metrics
from ciir.service.pipeline.options import KINDS
from ciir.service.web import problems
from ciir.service.web.middleware.api_keys import require_key
from ciir.service.web.middleware.body_limit import BodyLimit
from ciir.service.web.middleware.site import require_own_site
from ciir.service.web.middleware.tracking import UNLOGGED_PATHS, RequestTracking
from ciir.service.web.page import routes as page
from ciir.service.web.routes import docs, files, jobs, openapi, operations, results
from ciir.service.web.routes.events import OpenStreams
from ciir.service.web.routes.state import ServiceState

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from starlette.datastructures import Headers

    from ciir.service.settings import Settings

EXPOSED = (
    "Accept-Ranges",
    "Content-Disposition",
    "Content-Location",
    "Content-Range",
    "ETag",
    "Location",
    "Preference-Applied",
    "Retry-After",
    "Server-Timing",
    *map(results.name_id_header, KINDS),
    results.NOTES_HEADER,
    "X-Request-Id",
)
"""Response headers that scripts of allowed origins may read."""
ALLOWED = (
    "Authorization",
    "X-API-Key",
    "X-Request-Id",
    "Prefer",
    "If-None-Match",
    "Range",
    "If-Range",
    "Last-Event-ID",
)
"""Request headers that scripts of allowed origins may send, with those that every page may."""
ALLOWED_METHODS = ("GET", "POST", "DELETE")


def create_app(settings: Settings, engine: Engine | None = None) -> FastAPI:
    """Makes the application. `engine`: made from the settings if None.

    The application's lifespan starts and closes the engine. `app.state.service` is the state that the routes share.
    """
    engine = engine or Engine(settings, Metrics())
    streams = OpenStreams(settings.max_streams, settings.max_client_streams)
    app = FastAPI(
        title="ciir",
        description="Computational integral imaging reconstruction",
        version=version("ciir"),
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,  # a redirect would use any host that the request names
        lifespan=_lifespan,
        # Exports if OTEL_EXPORTER_OTLP_ENDPOINT is set.
        telemetry={"auto_configure": True, "exclude": lambda scope: scope.get("path") in UNLOGGED_PATHS},
    )
    app.openapi_version = "3.0.3"  # the newest version that the Swagger UI of swagger-ui-bundle supports
    app.state.service = ServiceState(settings, engine, streams)
    limits = dict.fromkeys((files.ROOT, *map(results.find_root, KINDS)), settings.max_body_bytes)
    app.add_middleware(BodyLimit, limits=limits, seconds=settings.body_seconds)
    if settings.cors_origins:
        app.add_middleware(
            _Cors,
            allow_origins=settings.cors_origins,
            allow_methods=ALLOWED_METHODS,
            allow_headers=ALLOWED,
            expose_headers=EXPOSED,
        )
    app.add_middleware(RequestTracking, metrics=engine.metrics)
    problems.add_handlers(app)
    app.add_exception_handler(jobs.NoMoreEvents, _handle_no_more_events)
    site = Depends(require_own_site(settings.hosts, settings.cors_origins))
    key = Depends(require_key(key.get_secret_value() for key in settings.api_keys))
    app.include_router(operations.health)
    app.include_router(page.router, dependencies=[site])
    app.include_router(operations.router, dependencies=[site, key])
    app.include_router(files.make_router(), dependencies=[site, key])
    for kind in KINDS.values():
        app.include_router(jobs.make_router(kind), dependencies=[site, key])
    docs.add_docs(app)
    openapi.add_schemas(app)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    state: ServiceState = app.state.service
    await to_thread.run_sync(state.engine.start)
    yield
    state.engine.jobs.watcher.stop()
    await to_thread.run_sync(state.engine.close)


class _Cors(CORSMiddleware):
    """Starlette's CORS middleware, with problems instead of plain text."""

    def preflight_response(self, request_headers: Headers) -> Response:
        response = super().preflight_response(request_headers)
        if response.status_code == 200:
            return response
        headers = {name: value for name, value in response.headers.items() if not name.startswith("content-")}
        cause = bytes(response.body).decode()
        detail = (
            f"{cause}; use an origin that CIIR_CORS_ORIGINS lists, one of the methods {', '.join(ALLOWED_METHODS)}, "
            f"and of the headers only {', '.join(ALLOWED)}"
        )
        return problems.respond_problem("", response.status_code, detail, headers=headers)


async def _handle_no_more_events(request: Request, error: Exception) -> Response:  # noqa: ARG001
    return Response(status_code=204)
