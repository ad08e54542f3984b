"""The HTML viewer in a browser: what it shows at each place and depth, by hand, by keys and on its tour."""

import re

import numpy as np
import pytest

from ciir.renderer.light_field import LightField
from ciir.renderer.writers.views import save_views
from tests.support.browser import needs_browser, open_browser, read_canvas
from tests.support.light_fields import make_views

pytestmark = needs_browser

UPPER, LOWER = 2, -3
"""By how many pixels the upper and the lower half of the picture move to the left from one view to the next."""
FIELD = LightField(make_views((5, 5), side=96, disparities=(-UPPER, -LOWER), channels=3), depth_sense="cameras")
INSIDE = slice(16, -16)
"""Columns to which no view's border comes."""
HALVES = {UPPER: slice(12, 36), LOWER: slice(60, 84)}
"""Rows of each half, away from the border between them."""
JPEG = 12
"""Levels by which JPEG of quality 95 changes pixels of this texture at most; by less than 2 in the mean."""


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


@pytest.fixture
def show(browser, tmp_path):
    """Opens the viewer of a light field, or of the last one again, at an address."""
    context = browser.new_context(has_touch=True)

    def open_viewer(field=FIELD, address=""):
        if field is not None:
            field.save(tmp_path / "a.html")
        page = context.new_page()
        page.goto(f"file://{tmp_path}/a.html#{address}")
        wait_for_rest(page)
        return page

    yield open_viewer
    context.close()


def wait_for_rest(page):
    """Waits until the last picture is drawn with all views: the address names then what is shown."""
    page.locator("canvas[aria-busy=false]").wait_for()


def read_address(page):
    return {name: float(value) for name, value in re.findall(r"(\w+)=([-0-9.]+)", page.url.partition("#")[2])}


def measure_sharpness(picture):
    """The mean difference of neighbouring pixels in each half."""
    return {half: np.abs(np.diff(picture[rows, INSIDE].astype(float), axis=1)).mean() for half, rows in HALVES.items()}


def refocus(views, disparity, aperture):
    """The mean of the views within `aperture` of the middle one, each shifted by whole pixels."""
    total, weights = np.zeros(views.shape[2:]), 0.0
    for v, u in np.ndindex(views.shape[:2]):
        down, right = v - views.shape[0] // 2, u - views.shape[1] // 2
        weight = min(max(1 + aperture - np.hypot(down, right), 0), 1)
        total += weight * np.roll(views[v, u].astype(float), (disparity * down, disparity * right), axis=(0, 1))
        weights += weight
    return total / weights


def is_near(picture, expected):
    difference = np.abs(picture.astype(float) - expected)
    return difference.max() <= JPEG and difference.mean() < 2


@pytest.mark.parametrize(("v", "u"), [(0, 0), (0, 4), (4, 0), (3, 1)])
def test_the_address_names_a_view(show, v, u):
    assert is_near(read_canvas(show(address=f"v={v}&u={u}&focus=0&aperture=0")), FIELD.view(v, u))


def test_between_views_the_nearest_are_blended(show):
    expected = FIELD.views[1, :2].mean(axis=0)
    assert is_near(read_canvas(show(address="v=1&u=0.5&focus=0&aperture=0")), expected)


def test_the_depth_slider_brings_one_depth_after_the_other_into_focus(show):
    page = show(address=f"focus={LOWER}&aperture=2")
    slider = page.locator("[name=focus]")
    shown = {}
    for depth in (UPPER, LOWER):
        slider.fill(str(depth))
        wait_for_rest(page)
        assert read_address(page)["focus"] == depth
        shown[depth] = read_canvas(page)
        expected = refocus(FIELD.views, depth, 2)
        for rows in HALVES.values():
            assert is_near(shown[depth][rows, INSIDE], expected[rows, INSIDE])
    assert np.abs(shown[UPPER].astype(int) - shown[LOWER]).mean() > 5
    for depth, other in ((UPPER, LOWER), (LOWER, UPPER)):
        assert measure_sharpness(shown[depth])[depth] > 2 * measure_sharpness(shown[other])[depth]


def test_the_aperture_slider_blurs_what_is_not_in_focus(show):
    page = show(address=f"focus={UPPER}&aperture=0")
    before = measure_sharpness(read_canvas(page))
    page.locator("[name=aperture]").fill("2")
    wait_for_rest(page)
    after = measure_sharpness(read_canvas(page))
    assert after[LOWER] < 0.5 * before[LOWER]
    assert after[UPPER] > 0.9 * before[UPPER]


@pytest.mark.parametrize("depth", [UPPER, LOWER])
def test_a_click_focuses_on_what_is_there(show, depth):
    page = show(address="focus=0&aperture=2")
    box = page.locator("canvas").bounding_box()
    row = (HALVES[depth].start + HALVES[depth].stop) / 2 / 96
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + row * box["height"])
    wait_for_rest(page)
    assert abs(read_address(page)["focus"] - depth) <= 0.25  # the step in which depth is searched for
    assert float(page.locator("[name=focus]").input_value()) == pytest.approx(read_address(page)["focus"], abs=0.05)


def test_a_drag_moves_the_viewpoint_with_the_scene(show):
    page = show(address="v=2&u=2&focus=0&aperture=0")
    box = page.locator("canvas").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.3, box["y"] + box["height"] / 2)
    page.mouse.up()
    wait_for_rest(page)
    assert read_address(page)["u"] == pytest.approx(3, abs=0.01)  # near things follow the hand
    assert read_address(page)["v"] == 2
    shown = page.locator("[role=status]").text_content()
    page.mouse.move(box["x"] + box["width"] * 0.8, box["y"] + box["height"] * 0.8)
    page.evaluate("() => new Promise(requestAnimationFrame)")
    assert page.locator("[role=status]").text_content() == shown


def test_a_drag_that_the_browser_takes_over_ends(show):
    page = show(address="v=2&u=2&focus=0&aperture=0")
    box = page.locator("canvas").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.locator("canvas").evaluate("each => each.dispatchEvent(new PointerEvent('pointercancel', { pointerId: 1 }))")
    page.mouse.move(box["x"] + box["width"] * 0.3, box["y"] + box["height"] / 2)
    page.mouse.up()
    page.locator("canvas").press("ArrowUp")
    wait_for_rest(page)
    assert (read_address(page)["v"], read_address(page)["u"]) == (1.5, 2)


def test_tilting_the_device_moves_the_viewpoint(show):
    page = show(address="v=2&u=2&focus=0&aperture=0")
    page.locator("[name=tilt]").evaluate("each => each.closest('label').hidden = false")
    tilt = "(beta, gamma) => dispatchEvent(new DeviceOrientationEvent('deviceorientation', { beta, gamma }))"
    page.evaluate(f"({tilt})(40, 5)")
    assert read_address(page)["u"] == 2
    page.locator("[name=tilt]").check()
    page.evaluate(f"({tilt})(40, 5)")  # as it is held: the centre
    page.evaluate(f"({tilt})(30, 15)")  # its right side goes away by 10 degrees, its upper side too
    wait_for_rest(page)
    assert (read_address(page)["v"], read_address(page)["u"]) == (3, 1)
    assert is_near(read_canvas(page), FIELD.view(3, 1))


def test_a_tour_goes_in_steps_where_less_motion_is_asked_for(show):
    page = show(address="focus=0&aperture=0")
    page.emulate_media(reduced_motion="reduce")
    page.locator("[name=tour]").check()
    page.evaluate("window.drawn = () => document.querySelector('canvas').toDataURL()")
    changes = page.evaluate(
        """async () => {
          let last = drawn(), changes = 0;
          for (let frame = 0; frame < 90; frame++) {
            await new Promise(requestAnimationFrame);
            if (drawn() !== last) changes++;
            last = drawn();
          }
          return changes;
        }"""
    )
    assert 1 <= changes <= 45  # of 90 frames in 1.5 s or, on a busy machine, in a few; without steps each frame differs


@pytest.mark.parametrize("stop", ["touch", "key"])
def test_the_tour_moves_and_stops_at_a_touch(show, stop):
    page = show(address="focus=0&aperture=0")
    at_rest = read_canvas(page)
    page.locator("[name=tour]").check()
    page.evaluate("window.drawn = () => document.querySelector('canvas').toDataURL()")
    for _ in range(3):  # it goes on
        before = page.evaluate("drawn()")
        page.wait_for_function("before => drawn() !== before", arg=before)
    assert not np.array_equal(read_canvas(page), at_rest)
    if stop == "touch":
        page.locator("canvas").tap()
    else:
        page.locator("canvas").press("ArrowLeft")
    assert not page.locator("[name=tour]").is_checked()
    wait_for_rest(page)
    stopped = read_canvas(page)
    page.evaluate("() => new Promise((done) => setTimeout(() => requestAnimationFrame(done), 100))")  # some frames
    assert np.array_equal(read_canvas(page), stopped)
    assert read_address(page)["u"] != 2


def test_keys_alone_reach_everything(show):
    page = show(address="v=2&u=2&focus=0&aperture=0")
    page.keyboard.press("Tab")
    for key in ("ArrowRight", "ArrowRight", "ArrowUp", "ArrowUp"):
        page.keyboard.press(key)
    wait_for_rest(page)
    assert is_near(read_canvas(page), FIELD.view(1, 3))
    page.keyboard.press("Tab")
    page.keyboard.press("ArrowRight")
    wait_for_rest(page)
    assert read_address(page)["focus"] == pytest.approx(0.05)
    page.keyboard.press("Tab")
    page.keyboard.press("End")
    wait_for_rest(page)
    assert read_address(page)["aperture"] == 2.5  # of 5x5 views
    page.keyboard.press("Tab")
    page.keyboard.press("Space")
    assert page.locator("[name=tour]").is_checked()
    page.keyboard.press("Space")
    assert not page.locator("[name=tour]").is_checked()


def test_both_depth_senses_look_the_same(show):
    """The slider's right end is near, and the right arrow key goes to the right."""
    shown = []
    for sense in ("cameras", "lenses"):
        page = show(FIELD.with_depth_sense(sense), "aperture=2")
        page.locator("[name=focus]").fill(str(UPPER))
        page.locator("canvas").press("ArrowRight")
        wait_for_rest(page)
        shown.append(read_canvas(page))
        assert read_address(page)["focus"] == UPPER
        np.testing.assert_array_equal(shown[-1], read_canvas(show(None, page.url.partition("#")[2])))
    np.testing.assert_array_equal(*shown)


def test_disparity_counts_pixels_of_the_views_as_read(browser, tmp_path):
    """Of lenses, upscaled: the views have twice the pixels, and other signs."""
    larger = FIELD.with_depth_sense("lenses").views.repeat(2, axis=2).repeat(2, axis=3)
    views = {view: larger[view] for view in np.ndindex(5, 5)}
    save_views(views, {"plan": {"scale": 2}}, tmp_path / "a.html", (5, 5), "lenses")
    page = browser.new_page()
    page.goto(f"file://{tmp_path}/a.html#focus={LOWER}&aperture=2")
    wait_for_rest(page)
    sharpness = np.abs(np.diff(read_canvas(page)[::2, ::2].astype(float), axis=1))
    assert sharpness[HALVES[LOWER], INSIDE].mean() > 2 * sharpness[HALVES[UPPER], INSIDE].mean()
    box = page.locator("canvas").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 4)
    wait_for_rest(page)
    assert read_address(page)["focus"] == pytest.approx(UPPER, abs=0.15)
    assert float(page.locator("[name=focus]").input_value()) == pytest.approx(UPPER, abs=0.2)
    assert f"Focus {read_address(page)['focus']:.2f} " in page.locator("[role=status]").text_content()
    page.close()
