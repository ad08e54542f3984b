import pytest
from playwright.sync_api import expect

from tests.support.browser import open_browser

WAIT_MILLISECONDS = 30_000
expect.set_options(timeout=WAIT_MILLISECONDS)


@pytest.fixture(scope="package")
def browser():
    with open_browser() as browser:
        yield browser


@pytest.fixture
def page(browser, server):
    """Opens the page. Nothing may fail, and no other host may be contacted.

    `page.expected` are parts of the console errors that a test expects, because a browser reports each refusal there.
    """
    context = browser.new_context(accept_downloads=True)
    page, problems = context.new_page(), []
    page.set_default_timeout(WAIT_MILLISECONDS)
    page.expected = []
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    own = (server, "blob:")
    page.on("request", lambda sent: None if sent.url.startswith(own) else problems.append(sent.url))
    page.goto(server)
    yield page
    context.close()
    assert [problem for problem in problems if not any(part in problem for part in page.expected)] == []
