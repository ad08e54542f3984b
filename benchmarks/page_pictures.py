"""Takes the pictures of the web page for README.md and docs/page.md, and those of the page's examples.

make serve &
python -m ciir.benchmarks.page_pictures [--url http://127.0.0.1:8000] [--out FOLDER] [--examples FOLDER] [NAME ...]
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
from contextlib import contextmanager
from math import cos, pi, sin
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

import ciir

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from playwright.sync_api import Browser, Page

WIDE, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
ADDRESS = "#scene=hamburger&lenses=150x150&pixels=9x9"
FRAMES, FRAME_MILLISECONDS = 40, 70
"""The animation's frames, once around."""
REACH = 0.4
"""How far the animation's pointer moves, as a share of the picture."""
WAIT_MILLISECONDS = 300_000
ARGUMENTS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""Arguments of Chromium: WebGL in software."""


def main(argv: list[str] | None = None) -> int:
    """Writes the pictures of `PICTURES` and the examples, or only the named ones."""
    parser = argparse.ArgumentParser(prog="benchmarks.page_pictures", description=main.__doc__)
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    parser.add_argument("--examples", type=Path, default=Path("service/web/page/assets/examples"))
    parser.add_argument("names", nargs="*", default=[*PICTURES, *EXAMPLES])
    args = parser.parse_args(argv)
    unknown = sorted(set(args.names) - {*PICTURES, *EXAMPLES})
    if unknown:
        parser.error(f"{', '.join(unknown)}: not known; give some of {', '.join([*PICTURES, *EXAMPLES])}")
    for scene in set(EXAMPLES) & set(args.names):
        view = ciir.render(f"scene:{scene}", lenses=(256, 256), pixels=(1, 1), sampling="lenslet").view(0, 0)
        Image.fromarray(view).save(args.examples / f"{scene}.jpg", quality=82)
    with open_browser() as browser:
        for name in args.names:
            if name in PICTURES:
                PICTURES[name](browser, args.url, args.out / name)
    return 0


@contextmanager
def open_browser() -> Iterator[Browser]:
    """Opens Debian's Chromium."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        yield browser
        browser.close()


def open_page(browser: Browser, url: str, size: dict[str, int], **options: str) -> Page:
    """Opens the page at an address, and waits until nothing is left to do."""
    page = browser.new_context(viewport=size, **options).new_page()  # type: ignore[arg-type]
    page.set_default_timeout(WAIT_MILLISECONDS)
    page.goto(url)
    if "#" in url:
        page.locator("#status", has_text="Done").wait_for()
        page.wait_for_timeout(1000)  # until the next job, if there is one, has begun
        page.locator("#job").wait_for(state="hidden")
        page.wait_for_timeout(3000)  # the views of its result come one by one
    return page


def show_start(browser: Browser, url: str, path: Path) -> None:
    """Takes the start page, where users choose a file or an example."""
    open_page(browser, url, WIDE).screenshot(path=path)


def show_compared(browser: Browser, url: str, path: Path) -> None:
    """Takes pixel mapping and the network side by side, at single pixels."""
    page = open_page(browser, f"{url}/{ADDRESS}&show=compare", WIDE)
    box = page.locator(".pictures").evaluate("each => each.getBoundingClientRect().toJSON()")
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.35 * box["height"])
    page.mouse.wheel(0, -700)
    page.screenshot(path=path)


def show_overlays(browser: Browser, url: str, path: Path) -> None:
    """Takes disparity and the EPI over a light field, in dark mode."""
    page = open_page(browser, f"{url}/{ADDRESS}&show=around", WIDE, color_scheme="dark")
    for name in ("Disparity", "EPI"):
        page.get_by_role("checkbox", name=name).check()
    page.get_by_alt_text("The disparity").wait_for()
    page.screenshot(path=path)


def show_phone(browser: Browser, url: str, path: Path) -> None:
    """Takes the page while looking around on a phone."""
    open_page(browser, f"{url}/{ADDRESS}&show=around", PHONE).screenshot(path=path)


def look_around(browser: Browser, url: str, path: Path) -> None:
    """Makes an animation of looking around, of the picture alone."""
    page = open_page(browser, f"{url}/{ADDRESS}&show=around", WIDE)
    box = page.locator(".picture canvas").evaluate("each => each.getBoundingClientRect().toJSON()")
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    reach = REACH * box["width"]
    frames = []
    page.mouse.move(*middle)
    page.mouse.down()
    for number in range(-1, FRAMES):  # the first leads from the middle to the circle
        angle = 2 * pi * number / FRAMES
        page.mouse.move(middle[0] + reach * cos(angle), middle[1] + 0.7 * reach * sin(angle))
        page.wait_for_timeout(FRAME_MILLISECONDS)
        frames.append(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
    small = [frame.resize((frame.width * 3 // 4, frame.height * 3 // 4), Image.Resampling.LANCZOS) for frame in frames]
    small[1].save(path, save_all=True, append_images=small[2:], duration=FRAME_MILLISECONDS, loop=0, quality=70)


PICTURES: dict[str, Callable[[Browser, str, Path], None]] = {
    "page.webp": look_around,
    "page_start.png": show_start,
    "page_compare.png": show_compared,
    "page_overlays.png": show_overlays,
    "page_phone.png": show_phone,
}
"""Pictures by their names in `docs/images`."""
EXAMPLES = ("vase", "globe", "hamburger")

if __name__ == "__main__":
    sys.exit(main())
