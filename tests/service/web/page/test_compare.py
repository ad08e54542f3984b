"""Pictures side by side and what is laid over a light field, in a browser."""

from base64 import b64decode, b64encode

import numpy as np
import pytest

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode
from tests.support.browser import needs_browser, open_browser, open_page, read_canvas
from tests.support.light_fields import make_views

pytestmark = needs_browser

TRUTH = np.random.default_rng(0).integers(0, 200, (64, 64, 3), np.uint8)
PICTURES = {"Half": TRUTH[::2, ::2], "Near": TRUTH + 2, "Far": TRUTH + 20}


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


@pytest.fixture
def page(browser):
    """A page of ours in which nothing may fail."""
    context = browser.new_context()
    page, problems = open_page(context)
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
          const { showComparison } = await import("/assets/compare.js");
          const blobs = Object.entries(pictures).map(([name, text]) => ({ name, picture: read(text) }));
          await showComparison(document.querySelector("main"), blobs, read(truth));
        }""",
        [{name: encode_text(picture) for name, picture in PICTURES.items()}, encode_text(TRUTH)],
    )
    return page


def test_the_divider_moves_by_keys(comparison):
    large = PICTURES["Half"].repeat(2, 0).repeat(2, 1)
    for key, border in (("", 32), ("Home", 0), ("End", 64)):
        if key:
            comparison.locator("[name=divider]").press(key)
        shown = read_canvas(comparison)
        left, right = slice(0, max(border - 1, 0)), slice(border + 1, 64)
        np.testing.assert_array_equal(shown[:, left], large[:, left])
        np.testing.assert_array_equal(shown[:, right], PICTURES["Far"][:, right])


def test_both_zoom_to_single_pixels_at_the_same_spot(comparison):
    for _ in range(5):
        comparison.locator("[name=zoom]").press("ArrowRight")
        for _ in range(5):  # to the upper left corner of what was seen before
            comparison.locator("canvas").press("ArrowLeft")
            comparison.locator("canvas").press("ArrowUp")
    shown = read_canvas(comparison)
    assert (shown[:, :31] == PICTURES["Half"][0, 0]).all()  # 2x2 pixels of 32: this one is twice as large
    assert (shown[:32, 33:] == PICTURES["Far"][0, 1]).all()
    assert (shown[32:, 33:] == PICTURES["Far"][1, 1]).all()


def test_the_difference_from_the_truth_is_shown_and_measured(comparison):
    comparison.locator("[name=left]").select_option("Near")
    status = comparison.locator("[role=status]").text_content()
    assert status == "Near: 42.11 dB · Far: 22.11 dB"  # 20 log10(255 / 2), and by 10 times the difference 20 dB less
    comparison.locator("[name=difference]").check()
    shown = read_canvas(comparison)
    assert (shown[:, :31] == 4 * 2).all()
    assert (shown[:, 33:] == 4 * 20).all()


def test_disparity_and_epi_lie_over_a_light_field(page, tmp_path):
    field = LightField(make_views((3, 5), side=64, channels=3), depth_sense="cameras")
    field.save(tmp_path / "a.zip", "tiles")
    coloured = np.full((64, 64, 3), (200, 30, 30), np.uint8)
    page.evaluate(
        """async ([tiles, coloured]) => {
          const [{ showLightField }, { addOverlays }] = await Promise.all(
            [import("/assets/light_field.js"), import("/assets/overlays.js")]);
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
    disparity.check()
    page.get_by_alt_text("The disparity of the centre view").wait_for()
    page.get_by_label("EPI", exact=True).check()
    page.locator("[name=epi]").press("Tab")
    page.get_by_label("Row of the EPI").fill("10")
    text = page.locator(".epi").evaluate("each => each.toDataURL().split(',')[1]")
    shown = decode(b64decode(text), name="epi")[..., :3].reshape(5, 8, 64, 3)
    assert np.ptp(shown, axis=1).max() == 0
    assert np.abs(shown[:, 0].astype(float) - field.epi(y=10, v=1)).mean() < 4  # JPEG
