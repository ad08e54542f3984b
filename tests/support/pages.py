"""The page's own files in a browser, without a server."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.service.web.page.routes import FILES, MEDIA_TYPES, POLICY

if TYPE_CHECKING:
    from playwright.sync_api import BrowserContext, Page, Route

HOST = "https://page.test"
EMPTY = '<!doctype html><title>page</title><link rel="stylesheet" href="/assets/viewer/viewer.css"><main></main>'


def open_page(
    context: BrowserContext, address: str = "", content: str = EMPTY, answers: dict[str, bytes] | None = None
) -> tuple[Page, list[str]]:
    """A page under the policy of ours, and a list of the errors in it; `answers`: of the server, by path."""

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
