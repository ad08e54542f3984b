"""Each state of the page for those who use no mouse, a screen reader, or large text."""

import re

import pytest
from playwright.sync_api import expect

from tests.support.browser import needs_browser
from tests.support.browser.access import check_access
from tests.support.browser.page import SMALL, choose, go_to, open_scene, set_field, wait_for_picture, wait_for_rest
from tests.support.inputs import EIA_PNG

pytestmark = needs_browser
LONG = f"{'a_name_without_spaces_' * 4}.obj"


def show_start(page):
    expect(page.get_by_role("heading", name="Look around")).to_be_visible()


def show_upscaled(page):
    open_scene(page)
    expect(page.locator("#status")).to_contain_text("Done in")
    page.get_by_text("Where the time went").click()


def show_notes(page):
    go_to(page, "#file=cube.obj&lenses=20x20&pixels=3x3")
    choose(page, ("cube.obj", b"mtllib gone.mtl\nv -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n"))
    wait_for_picture(page, 40, 40)
    expect(page.locator("#notes")).to_contain_text("gone.mtl")
    page.locator("#export-notes").evaluate("each => each.append('A note')")


def show_around(page):
    go_to(page, f"{SMALL}&show=around")
    for name in ("Disparity", "EPI"):
        page.get_by_role("checkbox", name=name).check()
    page.get_by_alt_text("The disparity").wait_for()
    wait_for_rest(page)


def show_compared(page):
    go_to(page, f"{SMALL}&show=compare")
    expect(page.locator("#frame [role=status]")).to_contain_text("dB")


def show_grid(page):
    choose(page, ("eia.png", EIA_PNG))
    expect(page.locator("[name=lenses]")).to_be_focused()
    set_field(page, "lenses", "6x9")
    wait_for_picture(page, 12, 18)
    page.get_by_role("radio", name="Lens grid").check()
    expect(page.locator(".view")).to_be_visible()


def show_problem(page):
    page.expected = ["415"]
    choose(page, (LONG, b"hello\n"))
    expect(page.get_by_role("alert")).to_contain_text("The server can't read this file")


def ask_for_a_key(page):
    page.expected = ["401"]
    refusal = {"status": 401, "content_type": "application/problem+json", "body": '{"detail": "no key"}'}
    page.route("**/v1/**", lambda route: route.fulfill(**refusal))
    page.get_by_role("link", name="Vase").click()
    expect(page.get_by_label("Key of this server")).to_be_visible()


def show_progress(page):
    page.route("**/v1/*/*/events", lambda _: None)  # the job waits as long as no event comes
    go_to(page, "#scene=vase&lenses=90x90&pixels=9x9&show=around")
    expect(page.get_by_role("button", name="Cancel")).to_be_visible()


def show_embedded(page):
    page.goto(f"{page.url}embed{SMALL}")
    wait_for_rest(page)


def show_embedded_problem(page):
    page.expected = ["422"]
    page.goto(f"{page.url}embed#scene=nope")
    expect(page.get_by_role("status")).to_contain_text(re.compile("does not fit. scene: .*vase"))


def show_exported(page):
    form = {"scene": "vase", "lenses": "20x30", "pixels": "3x3", "model": "none", "views": "all", "format": "html"}
    exported = page.request.post(f"{page.url}v1/reconstructions", multipart=form).body()
    page.route("**/exported.html", lambda route: route.fulfill(body=exported, content_type="text/html"))
    page.goto(f"{page.url}exported.html")
    wait_for_rest(page)


STATES = (
    show_start, show_upscaled, show_notes, show_around, show_compared, show_grid, show_problem, ask_for_a_key,
    show_progress, show_embedded, show_embedded_problem, show_exported,
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("show", STATES)
def test_all_can_use_each_state(page, show):
    show(page)
    check_access(page)
