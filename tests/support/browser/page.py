"""Actions on the web page: choosing and dropping files, changing settings, and waiting for a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from playwright.sync_api import expect

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Page, Route

SMALL = "#scene=vase&lenses=20x30&pixels=5x5"
"""The address of a scene that takes a tenth of a second."""


def choose(page: Page, *files: tuple[str, bytes]) -> None:
    """Chooses files, given as `(name, bytes)`."""
    listed = [{"name": name, "mimeType": "", "buffer": data} for name, data in files]
    page.locator("#files").set_input_files(listed)


def drop(page: Page, *paths: Path) -> None:
    """Drags files and folders of this machine over the window and drops them, as a file manager does."""
    devtools = page.context.new_cdp_session(page)
    data = {"items": [], "files": [str(path) for path in paths], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        devtools.send("Input.dispatchDragEvent", {"type": kind, "x": 200, "y": 200, "data": data})
        if kind == "dragOver":
            page.locator("body.dragging").wait_for()


def wait_for_picture(page: Page, height: int, width: int) -> None:
    """Waits until the page shows a picture of this size."""
    page.wait_for_function(
        "([h, w]) => { const found = document.querySelector('#frame img');"
        " return found && found.naturalHeight === h && found.naturalWidth === w; }",
        arg=[height, width],
    )


def wait_for_rest(page: Page) -> None:
    """Waits until a light field is drawn with all views."""
    page.locator("canvas[aria-busy=false]").wait_for()


def set_field(page: Page, name: str, value: str) -> None:
    """Fills in a setting, and moves on to the next one."""
    page.locator(f"#settings [name={name}]").fill(value)
    page.locator(f"#settings [name={name}]").press("Tab")


def go_to(page: Page, address: str) -> None:
    """Opens the page with a fragment in its address, such as `SMALL`."""
    page.goto(page.url.partition("#")[0] + address)


def open_scene(page: Page, lenses: str = "20x30") -> None:
    """Opens the vase with fewer lenses than usual."""
    go_to(page, f"#scene=vase&lenses={lenses}&pixels=5x5")
    height, width = map(int, lenses.split("x"))
    wait_for_picture(page, 2 * height, 2 * width)


def choose_mode(page: Page, name: str) -> None:
    """Chooses a display mode, such as `Look around`."""
    page.get_by_role("radio", name=name).check()


def hold_posts(page: Page, path: str, *fields: str) -> None:
    """Holds posts to `path` whose forms have all these fields, until the route is removed."""

    def hold(route: Route) -> None:
        if not all(f'name="{field}"' in (route.request.post_data or "") for field in fields):
            route.fallback()

    page.route(f"**/v1/{path}", hold)


def check_progress(page: Page) -> None:
    """Waits until the progress and the cancel button are in sight."""
    for part in (page.locator("#progress-text"), page.get_by_role("button", name="Cancel")):
        expect(part).to_be_in_viewport(ratio=1)
