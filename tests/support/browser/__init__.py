"""A browser for the pages: the system's Chromium, driven by Playwright. Tests are skipped if there is none."""

from __future__ import annotations

import shutil
from base64 import b64decode
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from ciir.service.web.page.routes import FILES, MEDIA_TYPES, POLICY

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray
    from playwright.sync_api import Browser, BrowserContext, Page, Route

CHROMIUM = shutil.which("chromium")
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
HOST = "https://page.test"
EMPTY = '<!doctype html><title>page</title><link rel="stylesheet" href="/assets/viewer/viewer.css"><main></main>'
WEBGL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PAGE = ["--disable-gpu-compositing", "--in-process-gpu"]
"""Options with which Chromium draws the page without WebGL, in a quarter less processor time."""


@contextmanager
def open_browser() -> Iterator[Browser]:
    """Opens the browser, with WebGL in software."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=WEBGL + PAGE)
        yield browser
        browser.close()


def read_canvas(page: Page) -> NDArray[np.uint8]:
    """Reads the pixels that the canvas shows, `(H, W, 3)`."""
    address = page.evaluate("document.querySelector('canvas').toDataURL('image/png')")
    return decode(b64decode(address.split(",")[1]), name="canvas")[..., :3].astype(np.uint8)


def open_page(
    context: BrowserContext, address: str = "", content: str = EMPTY, answers: dict[str, bytes] | None = None
) -> tuple[Page, list[str]]:
    """Opens a page under our own policy. Returns it with a list of its errors. `answers`: the server's, by path."""

    def respond(route: Route) -> None:
        path = route.request.url.removeprefix(HOST).partition("?")[0]
        name = path.removeprefix("/assets/")
        if path == "/":
            headers = {"Content-Security-Policy": POLICY, "Content-Type": "text/html"}
            route.fulfill(body=content, headers=headers)
        elif name in FILES:
            route.fulfill(body=FILES[name].read_bytes(), content_type=MEDIA_TYPES[FILES[name].suffix])
        elif path in (answers or {}):
            route.fulfill(body=(answers or {})[path])
        else:
            route.fulfill(status=404)

    problems: list[str] = []
    page = context.new_page()
    page.route("**/*", respond)
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.goto(f"{HOST}/#{address}")
    return page, problems
