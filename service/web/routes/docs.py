"""/docs: the page of Swagger UI, with all its files served from this server."""

from __future__ import annotations

import re
from base64 import b64encode
from hashlib import sha256

from fastapi import APIRouter, FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse
from starlette.staticfiles import StaticFiles


def add_docs(app: FastAPI) -> None:
    """Adds the page and its files."""
    from swagger_ui_bundle import swagger_ui_path

    page = get_swagger_ui_html(
        openapi_url="/openapi.json",
        title="ciir",
        swagger_js_url="/docs/static/swagger-ui-bundle.js",
        swagger_css_url="/docs/static/swagger-ui.css",
        swagger_favicon_url="/docs/static/favicon-32x32.png",
    )
    html = bytes(page.body).decode()
    policy = {"Content-Security-Policy": _make_policy(html)}
    routes = APIRouter()

    @routes.head("/docs", include_in_schema=False)
    @routes.get("/docs", include_in_schema=False)
    async def docs() -> HTMLResponse:
        return HTMLResponse(html, headers=policy)

    app.include_router(routes)
    app.mount("/docs/static", StaticFiles(directory=swagger_ui_path), name="docs-static")


def _make_policy(html: str) -> str:
    """Returns the page's Content-Security-Policy: files from this server, and its inline scripts by their hashes."""
    scripts = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    hashes = [f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'" for script in scripts]
    return (
        f"default-src 'none'; script-src 'self' {' '.join(hashes)}; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data:; connect-src 'self'; frame-ancestors 'none'"
    )
