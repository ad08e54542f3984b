"""The HTTP API. Work runs in threads, a bounded number at once; the event loop only passes bytes on."""

from __future__ import annotations

import asyncio
import hashlib
import json
import logging
import threading
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import IO, TYPE_CHECKING, Any

import anyio
import numpy as np
from anyio import to_thread
from fastapi import FastAPI, Request, Response
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse, StreamingResponse
from starlette.requests import ClientDisconnect
from starlette.staticfiles import StaticFiles

from models import catalogue
from models.skip import NOTHING
from renderer.bundle import Bundle
from renderer.views import parse_views
from service import enlarging, listing, multipart, problems, upload
from service.answers import Answer, answer
from service.body_limit import BodyLimit
from service.errors import NotReady
from service.plan import Plan
from service.request import AUTO_TAKES, NO_MODEL
from service.settings import Settings

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Iterator

    from service.report import Report
    from service.store import Store
    from service.upload import Upload

MEDIA_TYPES = {"png": "image/png", "zip": "application/zip", "npz": "application/x-npz"}
CHUNK = 2**18
WARM_GRID, WARM_VIEW = (3, 3), np.zeros((32, 32, 3), np.uint8)
"""What models are first run on: the least of a light field."""
WATCH_SECONDS = 0.5
"""How often it is asked whether a client is still there: nobody waits for a reconstruction that nobody will get."""
_log = logging.getLogger("uvicorn.error")


def create_app(settings: Settings | None = None) -> FastAPI:
    """The application; `settings` come from the environment where None is given."""
    settings = settings or Settings()
    app = FastAPI(
        title="ciir",
        description="Computational integral imaging reconstruction",
        version=version("ciir"),
        docs_url=None,
        redoc_url=None,
        lifespan=_lifespan,
    )
    app.openapi_version = "3.0.3"  # the newest that the Swagger UI of swagger-ui-bundle shows
    app.state.settings = settings
    app.state.store = settings.open_store()
    app.add_middleware(BodyLimit, limit=settings.max_body_bytes)
    problems.install(app)
    _add_reconstructions(app)
    _add_service(app)
    _add_docs(app)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    app.state.limiter = anyio.CapacityLimiter(app.state.settings.workers)
    app.state.warm = asyncio.create_task(to_thread.run_sync(_warm_up), name="warm-up")
    app.state.warm.add_done_callback(_log_failure)
    yield
    await asyncio.wait([app.state.warm])


def _warm_up() -> None:
    """Runs what the model `auto` may take once."""
    for model, is_light_field in ((catalogue.default(), False), (catalogue.field(), True)):
        if model in catalogue.names():
            run = enlarging.opened(Plan("upscale", model, 2, 1, (), is_light_field), WARM_GRID, NOTHING)
            run(dict.fromkeys(parse_views("all", *WARM_GRID), WARM_VIEW), [(1, 1)])


def _log_failure(warm: asyncio.Task[None]) -> None:
    if not warm.cancelled() and (error := warm.exception()) is not None:
        _log.error("the models can't be loaded; /readyz stays 503", exc_info=error)


def _require_ready(app: FastAPI) -> None:
    warm: asyncio.Task[None] = app.state.warm
    if not warm.done():
        raise NotReady("the models are being loaded; try again in a second")
    if warm.cancelled() or warm.exception() is not None:
        raise NotReady("the models can't be loaded; the server's log says why")


def _add_reconstructions(app: FastAPI) -> None:
    faults: dict[int | str, dict[str, Any]] = {
        status: {"description": text, "content": {problems.MEDIA_TYPE: {"schema": problems.SCHEMA}}}
        for status, text in (
            (400, "the multipart form is broken"),
            (413, "over a limit on bytes, pixels, files or triangles"),
            (415, "not multipart, or not a file of a kind that is read"),
            (422, "an option or the input's content is at fault"),
            (503, "the server is starting"),
        )
    }
    binary = {"schema": {"type": "string", "format": "binary"}}
    done: dict[int | str, dict[str, Any]] = {
        200: {"description": "the views", "content": dict.fromkeys(MEDIA_TYPES.values(), binary)}
    }

    @app.post(
        "/v1/reconstructions",
        summary="Views out of a mesh, an EIA picture or a zip of views",
        response_class=Response,
        responses=done | faults,
        openapi_extra={
            "requestBody": {"required": True, "content": {"multipart/form-data": {"schema": upload.SCHEMA}}}
        },
    )
    async def create_reconstruction(request: Request) -> Response:
        _require_ready(app)
        upload.check_content_type(request.headers.get("content-type"))
        parts = await multipart.read(request)
        gone = threading.Event()
        watch = asyncio.create_task(_watch(request, gone))
        try:
            given = upload.parse(parts.multi_items())
            id_, result = await to_thread.run_sync(
                _reconstruct, given, app.state.settings, app.state.store, gone, limiter=app.state.limiter
            )
        finally:
            watch.cancel()
            await parts.close()
        return _response(id_, result)


async def _watch(request: Request, gone: threading.Event) -> None:
    """Sets `gone` when the client has left."""
    while not await request.is_disconnected():
        await asyncio.sleep(WATCH_SECONDS)
    gone.set()


def _reconstruct(given: Upload, settings: Settings, store: Store | None, gone: threading.Event) -> tuple[str, Answer]:
    """The result's id, and the result. Runs in a worker thread.

    Raises `ClientDisconnect` at the next turn of views once `gone` is set.
    """

    def go_on(_: int) -> None:
        if gone.is_set():
            raise ClientDisconnect

    go_on(0)
    data = given.file.read()
    bundle = Bundle.from_upload(given.name, data)
    made = answer(
        bundle, given.options, given.format, store=store, max_pixels=settings.max_output_pixels, progress=go_on
    )
    if made.trouble:
        _log.warning("%s", made.trouble)
    return content_id(given, data, made.report), made


def content_id(given: Upload, data: bytes, report: Report) -> str:
    """What the result depends on, hashed: the input's bytes and kind, the options, the network, the backend and this
    version. 32 hexadecimal digits.
    """
    network = report["model"]["sha256"] if report["plan"]["model"] != NO_MODEL else None
    backend = report["plan"]["backend"]  # `auto` may take another one elsewhere
    key = json.dumps([version("ciir"), given.name, given.options.as_dict(), network, backend], sort_keys=True)
    return hashlib.sha256(key.encode() + b"\0" + data).hexdigest()[:32]


def _response(id_: str, result: Answer) -> StreamingResponse:
    # A zip and an npz hold a report with timings, so two of one id agree in all but some bytes: a weak tag.
    tag = f'"{id_}"' if result.format == "png" else f'W/"{id_}-{result.format}"'
    timings = result.report["timings_ms"]
    headers = {
        "Content-Length": str(result.size),
        "Content-Disposition": f'attachment; filename="{id_}.{result.format}"',
        "ETag": tag,
        "X-Reconstruction-Id": id_,
        "Server-Timing": ", ".join(f"{stage};dur={ms:.3f}" for stage, ms in timings.items()),
    }
    return StreamingResponse(_chunks(result.file), headers=headers, media_type=MEDIA_TYPES[result.format])


def _chunks(file: IO[bytes]) -> Iterator[bytes]:
    with file:
        while chunk := file.read(CHUNK):
            yield chunk


def _add_service(app: FastAPI) -> None:
    starting: dict[int | str, dict[str, Any]] = {
        503: {"description": "starting", "content": {problems.MEDIA_TYPE: {"schema": problems.SCHEMA}}}
    }

    @app.get(
        "/v1/models",
        summary="The models that can be named, with their cards",
        description=f"`default` is the one for single pictures. Where no model is named: {AUTO_TAKES}.",
    )
    def list_models() -> list[dict[str, Any]]:
        return listing.models()

    @app.head("/healthz", include_in_schema=False)  # what many load balancers ask with
    @app.get("/healthz", summary="Alive: the process answers")
    async def healthz() -> dict[str, str]:
        return {"status": "alive"}

    @app.head("/readyz", include_in_schema=False)
    @app.get("/readyz", summary="Ready: the models are loaded", responses=starting)
    async def readyz() -> dict[str, str]:
        _require_ready(app)
        return {"status": "ready"}


def _add_docs(app: FastAPI) -> None:
    from swagger_ui_bundle import swagger_ui_path

    app.mount("/docs/static", StaticFiles(directory=swagger_ui_path), name="docs-static")

    @app.get("/docs", include_in_schema=False)
    async def docs() -> HTMLResponse:
        return get_swagger_ui_html(
            openapi_url="/openapi.json",
            title="ciir",
            swagger_js_url="/docs/static/swagger-ui-bundle.js",
            swagger_css_url="/docs/static/swagger-ui.css",
            swagger_favicon_url="/docs/static/favicon-32x32.png",
        )
