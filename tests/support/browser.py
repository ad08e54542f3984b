"""A browser for the pages: the system's Chromium, which Playwright drives. Tests are skipped where there is none."""

from __future__ import annotations

import shutil
from base64 import b64decode
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from ciir.renderer.readers.pictures import decode

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray
    from playwright.sync_api import Browser, Page

CHROMIUM = shutil.which("chromium")
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
SOFTWARE_WEBGL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@contextmanager
def open_browser() -> Iterator[Browser]:
    """The browser, with WebGL in software."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE_WEBGL)
        yield browser
        browser.close()


def read_canvas(page: Page) -> NDArray[np.uint8]:
    """What the canvas shows, `(H, W, 3)`."""
    address = page.evaluate("document.querySelector('canvas').toDataURL('image/png')")
    picture: NDArray[np.uint8] = decode(b64decode(address.split(",")[1]), name="canvas")[..., :3]
    return picture
