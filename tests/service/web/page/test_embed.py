"""The viewer in a frame of another page, as docs/page.md has it."""

import re
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest

from tests.support.browser import needs_browser
from tests.support.paths import ROOT

pytestmark = [needs_browser, pytest.mark.slow]


class Quiet(SimpleHTTPRequestHandler):
    """Logs nothing."""

    def log_message(self, *_):
        """Nothing."""


@pytest.fixture
def other(tmp_path):
    """A folder, and the address of another site that serves it."""
    with ThreadingHTTPServer(("localhost", 0), partial(Quiet, directory=tmp_path)) as site:
        Thread(target=site.serve_forever, daemon=True).start()
        yield tmp_path, f"http://localhost:{site.server_port}"
        site.shutdown()


def test_another_page_frames_the_viewer(browser, server, other):
    folder, address = other
    frame = re.search(r"```html\n(.*?)```", (ROOT / "docs" / "page.md").read_text(), re.DOTALL)[1]
    content = "<!doctype html><title>other</title>" + frame.replace("http://127.0.0.1:8000", server)
    (folder / "page.html").write_text(content)
    page, problems = browser.new_page(), []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.goto(f"{address}/page.html")
    viewer = page.frame_locator("iframe")
    viewer.locator("canvas[aria-busy=false]").wait_for()
    viewer.locator("canvas").press("Control+ArrowRight")  # the browser's
    viewer.locator("canvas").press("ArrowRight")
    viewer.get_by_role("status").filter(has_text="View 7.0, 6.5").wait_for()
    allowed = viewer.locator("html").evaluate("() => document.featurePolicy.allowedFeatures()")
    assert {"accelerometer", "gyroscope"} <= set(allowed)
    assert problems == []
    page.close()
