"""/ and /embed: the web page and the viewer on its own; /assets: their files, all from this package."""

from __future__ import annotations

import json
from base64 import b64encode
from hashlib import sha256
from pathlib import Path, PurePath

from fastapi import APIRouter, Request, Response
from starlette.exceptions import HTTPException

from ciir.renderer.writers import formats, html, pictures, stacks
from ciir.renderer.writers.depth import maps
from ciir.service.pipeline.options import KINDS
from ciir.service.web.middleware.tracking import ANY_FRAME
from ciir.service.web.routes.results import has_tag

FOLDERS = {"": Path(__file__).parent / "assets", "viewer/": Path(html.__file__).parent / "viewer"}
"""The folders of the files, by the start of their names. The viewer is that of the HTML export."""
MEDIA_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".jpg": "image/jpeg",
    ".js": "text/javascript",
    ".json": "application/json",
    ".png": "image/png",
    ".svg": "image/svg+xml",
}
"""Media types of the files that are served, by suffix."""
FILES = {
    start + path.relative_to(folder).as_posix(): path
    for start, folder in FOLDERS.items()
    for path in folder.rglob("*")
    if path.suffix in MEDIA_TYPES
}
"""All files that are served, by name."""
_FORMATS = {
    "PICTURES": pictures.FORMATS,
    "VIDEOS": formats.VIDEOS,
    "WHOLE": [name for name in KINDS["reconstruction"].formats if name in formats.WHOLE and name != "epi"],
    "STACKS": stacks.STACK,
    "MAPS": maps.FORMATS,
}
MADE = {"formats.js": "".join(f"export const {key} = {json.dumps([*names])};\n" for key, names in _FORMATS.items())}
"""The content of files that the server makes, by name: the names of formats, for the page's menu."""
_MAP = FILES["index.html"].read_bytes().partition(b'<script type="importmap">')[2].partition(b"</script>")[0]
POLICY = (
    # The import map is not code: it names the files of packages, and must be inside the page, hence its hash.
    f"default-src 'none'; script-src 'self' 'sha256-{b64encode(sha256(_MAP).digest()).decode()}'; "
    "style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self' blob: data:; base-uri 'none'; form-action 'none'; "  # a mesh's textures are blobs and data
)
"""The Content-Security-Policy of the pages, except for who may frame them."""
VERSIONED = "vendor/"
"""The start of names that contain a version. Such files never change."""

router = APIRouter(include_in_schema=False)


@router.head("/")
@router.get("/")
def read_page(request: Request) -> Response:
    """Serves the page."""
    return _respond(request, "index.html", {"Content-Security-Policy": f"{POLICY}frame-ancestors 'none'"})


@router.head("/embed")
@router.get("/embed")
def read_embedded_page(request: Request) -> Response:
    """Serves the viewer on its own, which any page may frame."""
    return _respond(request, "embed.html", {"Content-Security-Policy": POLICY + ANY_FRAME})


@router.head("/assets/{name:path}")
@router.get("/assets/{name:path}")
def read_asset(request: Request, name: str) -> Response:
    """Serves a file of the page. Raises `HTTPException` 404."""
    return _respond(request, name, {})


def _respond(request: Request, name: str, headers: dict[str, str]) -> Response:
    if name not in FILES and name not in MADE:
        raise HTTPException(404)
    content = MADE[name].encode() if name in MADE else FILES[name].read_bytes()
    digest = sha256(content).hexdigest()[:32]
    is_fixed = name.startswith(VERSIONED)
    headers |= {
        "ETag": f'"{digest}"',
        "Cache-Control": "public, max-age=31536000, immutable" if is_fixed else "no-cache",
    }
    if has_tag(request.headers.getlist("if-none-match"), f'"{digest}"'):
        return Response(status_code=304, headers=headers)
    return Response(content, headers=headers, media_type=MEDIA_TYPES[PurePath(name).suffix])
