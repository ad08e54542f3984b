"""Looking around and comparing on the page, with a real server and real networks."""

import re

import numpy as np

from tests.support.browser import needs_browser, read_canvas
from tests.support.browser.page import go_to, wait_for_rest

pytestmark = needs_browser

TILT = "angles => dispatchEvent(new DeviceOrientationEvent('deviceorientation', angles))"
ADDRESS = "#scene=vase&lenses=40x40&pixels=5x5"


def test_each_way_of_moving_shows_other_pixels(browser, server):
    context = browser.new_context(has_touch=True)  # a device that may say how it is held
    page = context.new_page()
    page.goto(f"{server}/{ADDRESS}&show=around")
    page.get_by_role("checkbox", name="Disparity").wait_for()  # the upscaled views are there

    def drag():
        box = page.locator("canvas").bounding_box()
        page.mouse.move(box["x"] + 100, box["y"] + 100)
        page.mouse.down()
        page.mouse.move(box["x"] + 20, box["y"] + 150)
        page.mouse.up()

    def tilt():
        page.get_by_role("checkbox", name="Tilt the device").check()
        for beta, gamma in ((40, 5), (35, 15)):
            page.evaluate(
                f"dispatchEvent(new DeviceOrientationEvent('deviceorientation', {{ beta: {beta}, gamma: {gamma} }}))"
            )

    def tour():
        before = page.evaluate("document.querySelector('canvas').toDataURL()")
        page.get_by_role("checkbox", name="Tour").check()
        page.wait_for_function("before => document.querySelector('canvas').toDataURL() !== before", arg=before)
        page.get_by_role("checkbox", name="Tour").uncheck()

    seen = []
    for move in (lambda: None, drag, lambda: page.locator("canvas").press("ArrowRight"), tilt, tour):
        move()
        wait_for_rest(page)
        seen.append(read_canvas(page))
        assert not any(np.array_equal(seen[-1], other) for other in seen[:-1]), move
    page.get_by_role("checkbox", name="Disparity").check()
    page.get_by_alt_text("The disparity of the centre view").wait_for()
    context.close()


def test_what_one_clicks_is_sharp(page):
    go_to(page, "#scene=hamburger&lenses=80x80&pixels=7x7&show=around&model=none&aperture=3&focus=0")
    page.get_by_role("checkbox", name="Disparity").wait_for()
    box = page.locator("canvas").bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.4 * box["height"])
    wait_for_rest(page)
    slider = page.get_by_label("Depth in focus")
    clicked, sharpness = float(slider.input_value()), {}
    for away in (0, 2, -2):
        slider.fill(f"{clicked + away:.2f}")
        wait_for_rest(page)
        around = read_canvas(page)[24:40, 30:50].astype(float)
        sharpness[away] = np.abs(np.diff(around, axis=1)).mean()
    assert sharpness[0] > 1.3 * max(sharpness[2], sharpness[-2]), sharpness


def test_networks_are_compared_with_the_truth(page):
    go_to(page, f"{ADDRESS}&show=compare")
    status = page.locator(".comparison [role=status]")
    left = page.get_by_label("Picture at the left")
    shown = {}
    for name in ("As mapped", "Bicubic", "Upscaled", "fast"):
        left.select_option(name)
        status.filter(has_text=f"{name}:").wait_for()
        shown[name] = re.search(r": ([\d.]+) dB, SSIM ([\d.]+)", status.text_content()).groups()
    assert 20 < float(shown["As mapped"][0]) < float(shown["Upscaled"][0]) < 60, shown
    assert 0.5 < float(shown["As mapped"][1]) < float(shown["Upscaled"][1]) <= 1, shown
    left.select_option("Rendered at the larger size")
    status.locator("span", has_text=re.compile("size$")).wait_for()
