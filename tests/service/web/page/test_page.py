"""The page in a browser, on a real server."""

import pytest

from tests.support.browser import needs_browser, open_browser
from tests.support.inputs import EIA_PNG
from tests.support.servers import run_server

pytestmark = needs_browser


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with run_server(tmp_path_factory.mktemp("page") / "log", CIIR_WORKERS="1") as server:
        yield server


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


@pytest.fixture
def page(browser, server):
    """The page; nothing may fail, and no other host may be asked."""
    context = browser.new_context()
    page, problems = context.new_page(), []
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    own = (server.url, "blob:")
    page.on("request", lambda sent: None if sent.url.startswith(own) else problems.append(sent.url))
    page.goto(server.url)
    yield page
    context.close()
    assert problems == []


def show(page, lenses):
    """The height and the width of the view that the button shows."""
    page.locator("#lenses").fill(lenses)
    page.get_by_role("button", name="Show").click()
    page.get_by_role("img").wait_for()
    page.wait_for_function("document.querySelector('#view').naturalWidth > 0")
    return page.evaluate("[view.naturalHeight, view.naturalWidth]")


def test_a_file_is_shown(page):
    page.locator("#file").set_input_files({"name": "eia.png", "mimeType": "image/png", "buffer": EIA_PNG})
    assert show(page, "6x9") == [6, 9]


def test_a_shipped_scene_is_shown(page):
    page.locator("#scene").select_option("vase")
    assert show(page, "20x30") == [20, 30]
