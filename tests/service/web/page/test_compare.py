"""Pictures side by side and what is laid over a light field, in a browser."""

from base64 import b64decode, b64encode

import numpy as np
import pytest

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode
from ciir.service.demo.scores import compare
from tests.support.browser import EMPTY, needs_browser, open_page
from tests.support.light_fields import make_views

pytestmark = needs_browser

TRUTH = np.random.default_rng(0).integers(0, 200, (64, 64, 3), np.uint8)
PICTURES = {"Half": TRUTH[::2, ::2], "Near": TRUTH + 2, "Far": TRUTH + 20}
STYLED = f"{EMPTY}<link rel=stylesheet href=/assets/style.css>"
TOP = slice(0, 20)
"""Rows of pixels above the divider's handle."""


@pytest.fixture
def page(browser):
    """A page of ours in which nothing may fail."""
    context = browser.new_context(has_touch=True)
    page, problems = open_page(context, content=STYLED)
    page.evaluate(
        "() => (window.read = (text) => new Blob([Uint8Array.from(atob(text), (each) => each.charCodeAt(0))]))"
    )
    yield page
    context.close()
    assert problems == []


def encode_text(picture):
    return b64encode(encode(np.ascontiguousarray(picture), ".png")).decode()


@pytest.fixture
def comparison(page):
    page.evaluate(
        """async ([pictures, truth]) => {
          const { showComparison } = await import("/assets/results/compare.js");
          window.made = [];
          const ways = Object.entries(pictures).map(
            ([name, text]) => ({ name, make: async () => (made.push(name), read(text)) }));
          const { signal } = new AbortController();
          const element = document.querySelector("main");
          await showComparison(element, ways, [0, 2], read(truth), signal, (load) => load(signal));
        }""",
        [{name: encode_text(picture) for name, picture in PICTURES.items()}, encode_text(TRUTH)],
    )
    return page


def read_pixels(page, count=64):
    """What is shown at the middles of `count x count` places."""
    shown = decode(page.locator(".pictures").screenshot(), name="shown")[..., :3]
    rows, cols = (((np.arange(count) + 0.5) * side / count).astype(int) for side in shown.shape[:2])
    return shown[np.ix_(rows, cols)]


def read_zoom(page):
    return page.locator(".pictures").evaluate("each => Number(each.style.getPropertyValue('--zoom'))")


def test_the_divider_is_moved_by_keys_and_dragged(comparison):
    large = PICTURES["Half"].repeat(2, 0).repeat(2, 1)

    def check(border):
        shown = read_pixels(comparison)[TOP]
        left, right = slice(0, max(border - 1, 0)), slice(border + 1, 64)
        np.testing.assert_array_equal(shown[:, left], large[TOP, left])
        np.testing.assert_array_equal(shown[:, right], PICTURES["Far"][TOP, right])

    check(32)
    divider = comparison.locator("[name=divider]")
    for key, border in (("Home", 0), ("End", 64)):
        divider.press(key)
        check(border)
    box = comparison.locator(".pictures").bounding_box()
    middle = box["y"] + box["height"] / 2
    comparison.mouse.move(box["x"] + box["width"] - 1, middle)
    comparison.mouse.down()
    comparison.mouse.move(box["x"] + box["width"] / 4, middle)
    comparison.mouse.up()
    check(16)


def test_both_zoom_to_single_pixels_at_the_same_spot(comparison):
    pictures = comparison.locator(".pictures")
    for key in ("+", "ArrowLeft", "ArrowUp"):
        for _ in range(15):
            pictures.press(key)
    shown = read_pixels(comparison, 8)[:4]  # 8 of 64 pixels
    np.testing.assert_array_equal(shown[:, :3], PICTURES["Half"].repeat(2, 0).repeat(2, 1)[:4, :3])
    np.testing.assert_array_equal(shown[:3, 5:], PICTURES["Far"][:3, 5:8])
    pictures.press("0")
    np.testing.assert_array_equal(read_pixels(comparison)[TOP, 34:], PICTURES["Far"][TOP, 34:])


def test_the_wheel_zooms_around_the_pointer(comparison):
    box = comparison.locator(".pictures").bounding_box()
    pixel = box["width"] / 64
    comparison.mouse.move(box["x"] + 50.5 * pixel, box["y"] + 10.5 * pixel)
    comparison.mouse.wheel(0, -800)
    assert read_zoom(comparison) == 4
    np.testing.assert_array_equal(read_pixels(comparison)[10, 50], PICTURES["Far"][10, 50])
    comparison.mouse.down()
    comparison.mouse.move(box["x"] + 54.5 * pixel, box["y"] + 10.5 * pixel)  # one of its pixels
    comparison.mouse.up()
    np.testing.assert_array_equal(read_pixels(comparison)[10, 50], PICTURES["Far"][10, 49])
    comparison.mouse.wheel(0, 8000)
    assert read_zoom(comparison) == 1


def test_two_fingers_zoom(comparison):
    box = comparison.locator(".pictures").bounding_box()
    devtools = comparison.context.new_cdp_session(comparison)

    def touch(kind, *shares):
        points = [
            {"x": box["x"] + share * box["width"], "y": box["y"] + box["height"] / 4, "id": number}
            for number, share in enumerate(shares)
        ]
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", 0.7, 0.8)
    touch("touchMove", 0.65, 0.85)
    touch("touchEnd")
    assert read_zoom(comparison) == pytest.approx(2, rel=1e-3)
    # what is between the fingers stays there, the left edge of pixel 48
    np.testing.assert_array_equal(read_pixels(comparison)[16, 48], PICTURES["Far"][16, 48])


def test_a_picture_is_made_when_it_is_first_shown(comparison):
    assert comparison.evaluate("made") == ["Half", "Far"]
    for name in ("Near", "Half", "Near"):
        comparison.locator("[name=left]").select_option(name)
    comparison.locator("[role=status]", has_text="Near").wait_for()
    assert comparison.evaluate("made") == ["Half", "Far", "Near"]


def test_the_difference_from_the_truth_is_shown(comparison):
    comparison.locator("[name=left]").select_option("Near")
    comparison.locator("[name=difference]").check()
    comparison.locator("[role=status]", has_text="Near").wait_for()
    shown = read_pixels(comparison)[TOP]
    assert (shown[:, :31] == 4 * 2).all()
    assert (shown[:, 33:] == 4 * 20).all()


def test_psnr_and_ssim_are_those_of_the_demo(comparison):
    status = comparison.locator("[role=status]")
    for name, made in PICTURES.items():
        comparison.locator("[name=left]").select_option(name)
        status.filter(has_text=f"{name}:").wait_for()
        picture = made.repeat(2, 0).repeat(2, 1) if name == "Half" else made
        assert status.locator("span").first.text_content() == f"{name}: {compare(picture, TRUTH)}"


def test_disparity_and_epi_lie_over_a_light_field(page, tmp_path):
    field = LightField(make_views((3, 5), side=64, channels=3), depth_sense="cameras")
    field.save(tmp_path / "a.zip", "tiles")
    coloured = np.full((64, 64, 3), (200, 30, 30), np.uint8)
    page.evaluate(
        """async ([tiles, coloured]) => {
          const [{ showLightField }, { addOverlays }] = await Promise.all(
            [import("/assets/results/light_field.js"), import("/assets/results/overlays.js")]);
          const stage = await showLightField(document.querySelector("main"), new Response(read(tiles)));
          let calls = 0;
          addOverlays(stage, async () => {
            if (calls++ === 0) throw new Error("The server is busy.");
            return read(coloured);
          });
        }""",
        [b64encode((tmp_path / "a.zip").read_bytes()).decode(), encode_text(coloured)],
    )
    page.locator("canvas[aria-busy=false]").wait_for()
    disparity = page.get_by_label("Disparity")
    disparity.dispatch_event("click")  # `check` would find it unchecked again
    page.get_by_text("The server is busy.").wait_for()
    assert not disparity.is_checked()
    page.locator(".picture canvas").press("ArrowRight")
    disparity.check()
    page.get_by_alt_text("The disparity of the centre view").wait_for()
    page.get_by_text("View 1.0, 2.0").wait_for()  # the centre
    page.get_by_label("EPI", exact=True).check()
    page.locator("[name=epi]").press("Tab")
    page.get_by_label("Row of the EPI").fill("10")

    def check_row(y):
        text = page.locator(".epi").evaluate("each => each.toDataURL().split(',')[1]")
        shown = decode(b64decode(text), name="epi")[..., :3]
        assert np.abs(shown.astype(float) - field.epi(y=y, v=1)).mean() < 4  # JPEG

    check_row(10)
    canvas = page.locator(".picture canvas")
    box = canvas.bounding_box()
    canvas.click(position={"x": 5, "y": box["height"] * 40.5 / 64})
    check_row(40)
