"""Looking around and comparing on the page, with a real server and real networks."""

import re

import numpy as np

from tests.support.browser import needs_browser, read_canvas

pytestmark = needs_browser

ADDRESS = "#scene=vase&lenses=40x40&pixels=5x5"


def test_a_scene_is_looked_around_in_and_its_disparity_shown(page):
    page.goto(f"{page.url.partition('#')[0]}{ADDRESS}&show=around")
    page.locator("canvas[aria-busy=false]").wait_for()
    before = read_canvas(page)
    page.locator("canvas").press("ArrowRight")
    page.locator("canvas[aria-busy=false]").wait_for()
    assert not np.array_equal(read_canvas(page), before)
    page.get_by_role("checkbox", name="Disparity").check()
    page.get_by_alt_text("The disparity of the centre view").wait_for()


def test_networks_are_compared_with_the_truth(page):
    page.goto(f"{page.url.partition('#')[0]}{ADDRESS}&show=compare")
    status = page.locator(".comparison [role=status]")
    status.wait_for()
    shown = {}
    for name in ("As mapped", "Bicubic", "Upscaled"):
        page.get_by_label("Picture at the left").select_option(name)
        shown[name] = float(re.search(r": ([\d.]+) dB", status.text_content())[1])
    assert 20 < shown["As mapped"] < shown["Upscaled"] < 60, shown
