"""Light fields that arrive in tiles: small views first, then the others, in the viewer of the page."""

import re
import zipfile
from base64 import b64encode

import numpy as np
import pytest

from ciir.renderer.light_field import LightField
from ciir.service.web.page.routes import FILES
from tests.support.browser import needs_browser, open_page, read_canvas
from tests.support.light_fields import make_views

pytestmark = needs_browser

FIELD = LightField(make_views((5, 5), side=100, disparities=(-2, 3), channels=3), depth_sense="cameras")
JPEG = 4
"""Levels by which JPEG of quality 90 changes this texture in the mean, at most."""
STREAM = """
  window.stream = null;
  window.push = (text) => stream.enqueue(Uint8Array.from(atob(text), (each) => each.charCodeAt(0)));
  const body = new ReadableStream({ start: (controller) => (window.stream = controller) });
  window.shown = import("/assets/results/light_field.js")
    .then(({ showLightField }) => showLightField(document.querySelector("main"), new Response(body)))
    .then(() => "all views", (error) => error.message);
"""


@pytest.fixture
def page(browser):
    """A page into which `push` sends the bytes of a light field; nothing may fail in it."""
    context = browser.new_context(has_touch=True)
    page, problems = open_page(context, "v=1&u=1&focus=0&aperture=0&scene=vase")
    page.evaluate(f"() => {{ {STREAM} }}")
    yield page
    context.close()
    assert problems == []


def make_tiles(path, field=FIELD):
    """The zip, and where its members begin."""
    field.save(path, "tiles")
    with zipfile.ZipFile(path) as archive:
        names = [member.filename for member in archive.infolist()]
        starts = [member.header_offset for member in archive.infolist()]
        return path.read_bytes(), dict(zip(names, [*starts[1:], archive.start_dir], strict=True))


def push(page, content):
    page.evaluate("text => push(text)", b64encode(content).decode())


def wait_for_rest(page):
    page.locator("canvas[aria-busy=false]").wait_for()


def measure_error(page, view=(1, 1)):
    return np.abs(read_canvas(page).astype(float) - FIELD.view(*view)).mean()


def test_small_views_show_first_and_give_way_to_the_others(page, tmp_path):
    content, ends = make_tiles(tmp_path / "a.zip")
    assert list(ends)[:3] == ["light_field.json", "coarse.jpg", "row_02.jpg"]
    push(page, content[: ends["coarse.jpg"]])
    wait_for_rest(page)
    coarse = measure_error(page)
    assert coarse > 2 * JPEG
    small = FIELD.view(1, 1).reshape(25, 4, 25, 4, 3).mean((1, 3)).repeat(4, 0).repeat(4, 1)
    shown = read_canvas(page).reshape(25, 4, 25, 4, 3).mean((1, 3))
    assert np.corrcoef(shown.ravel(), small[::4, ::4].ravel())[0, 1] > 0.9  # the same view, interpolated
    push(page, content[ends["coarse.jpg"] : ends["row_02.jpg"]])
    page.locator("canvas").press("ArrowDown")
    page.locator("canvas").press("ArrowDown")
    wait_for_rest(page)
    assert measure_error(page, (2, 1)) < JPEG
    push(page, content[ends["row_02.jpg"] : ends["row_01.jpg"] - 9])  # a part of a row
    page.locator("canvas").press("ArrowUp")
    page.locator("canvas").press("ArrowUp")
    wait_for_rest(page)
    assert measure_error(page) == pytest.approx(coarse, abs=0.1)
    push(page, content[ends["row_01.jpg"] - 9 :])
    assert page.evaluate("shown") == "all views"
    wait_for_rest(page)
    assert measure_error(page) < JPEG
    assert re.search(r"#v=1&u=1&focus=0&aperture=0&scene=vase$", page.url)  # other settings are kept


def test_views_as_mapped_stand_for_those_that_are_upscaled(page, tmp_path):
    """They are shown in the size of the larger ones, which then come into the same canvas."""
    small = LightField(np.ascontiguousarray(FIELD.views[:, :, ::2, ::2]), depth_sense="cameras")
    mapped, _ = make_tiles(tmp_path / "a.zip", small)
    larger, ends = make_tiles(tmp_path / "b.zip")
    load = """([text, scale]) => import("/assets/results/light_field.js").then(({ showLightField }) => showLightField(
        document.querySelector("main"),
        new Response(Uint8Array.from(atob(text), (each) => each.charCodeAt(0))),
        { scale },
    )).then(() => "shown", (error) => error.message)"""
    assert page.evaluate(load, [b64encode(mapped).decode(), 2]) == "shown"
    wait_for_rest(page)
    canvas = page.locator("canvas").element_handle()
    enlarged = np.repeat(np.repeat(small.view(1, 1), 2, 0), 2, 1)
    before = read_canvas(page)
    assert before.shape == enlarged.shape
    assert np.corrcoef(before.ravel(), enlarged.ravel())[0, 1] > 0.9  # interpolated
    part = b64encode(larger[: ends["coarse.jpg"]]).decode()
    assert "connection broke" in page.evaluate(load, [part, 1])
    wait_for_rest(page)
    np.testing.assert_array_equal(read_canvas(page), before)  # they are smaller than those that are there
    assert page.evaluate(load, [b64encode(larger).decode(), 1]) == "shown"
    wait_for_rest(page)
    assert measure_error(page) < JPEG
    assert canvas.evaluate("each => each.isConnected")


@pytest.mark.parametrize(("depth", "other", "y"), [(-2, 3, 0.25), (3, -2, 0.75)])
def test_what_one_clicks_is_sharp(page, tmp_path, depth, other, y):
    push(page, make_tiles(tmp_path / "a.zip")[0])
    page.evaluate("shown")
    rows, columns = slice(int(100 * y) - 10, int(100 * y) + 10), slice(20, -20)
    sharpness = {}
    page.locator("[name=aperture]").fill("2")
    for clicked in (y, 1 - y):
        box = page.locator("canvas").bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + clicked * box["height"])
        wait_for_rest(page)
        focus = float(re.search(r"focus=([-.\d]+)", page.url)[1])
        assert focus == pytest.approx(-depth if clicked == y else -other, abs=0.15)
        sharpness[clicked] = np.abs(np.diff(read_canvas(page)[rows, columns].astype(float), axis=1)).mean()
    assert sharpness[y] > 2 * sharpness[1 - y]


def test_the_place_is_forgotten_for_a_light_field_of_another_size(page, tmp_path):
    push(page, make_tiles(tmp_path / "a.zip")[0])
    page.evaluate("shown")
    wait_for_rest(page)
    page.evaluate(f"() => {{ {STREAM} }}")
    push(page, make_tiles(tmp_path / "b.zip", LightField(FIELD.views[:3, :3], depth_sense="cameras"))[0])
    page.evaluate("shown")
    wait_for_rest(page)
    assert "v=1&u=1&" in page.url  # the centre
    assert page.locator("canvas").count() == 1
    assert not page.url.endswith("focus=0&aperture=0")


def test_a_network_error_is_reported_in_plain_words(page):
    page.evaluate("stream.error(new TypeError('network error'))")
    assert "connection broke" in page.evaluate("shown")


def test_lost_webgl_is_reported(page, tmp_path):
    push(page, make_tiles(tmp_path / "a.zip")[0])
    page.evaluate("shown")
    wait_for_rest(page)
    page.evaluate(
        "document.querySelector('canvas').getContext('webgl2').getExtension('WEBGL_lose_context').loseContext()"
    )
    status = page.locator("[role=status]", has_text="WebGL was lost")
    status.wait_for()
    page.locator("canvas").press("ArrowDown")
    page.evaluate("() => new Promise(requestAnimationFrame)")
    assert status.is_visible()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: b"<html>" + content, "not a light field"),
        (lambda content: content[:100], "connection broke"),
        (lambda content: content[:8] + b"\x08" + content[9:], "not a light field"),  # deflated
    ],
)
def test_what_is_no_light_field_is_refused(page, tmp_path, change, message):
    push(page, change(make_tiles(tmp_path / "a.zip")[0]))
    page.evaluate("stream.close()")
    assert message in page.evaluate("shown")


@pytest.mark.parametrize(
    ("address", "sent"),
    [("scene=vase&lenses=40x40", {"scene": "vase", "lenses": "40x40"}), ("job=abc", {})],
)
def test_the_viewer_alone_shows_what_the_address_names(browser, tmp_path, address, sent):
    answers = {
        "/v1/reconstructions": b'{"id": "abc", "state": "done"}',
        "/v1/reconstructions/abc/result": make_tiles(tmp_path / "a.zip")[0],
    }
    address += "&show=upscaled&u=0&v=3&focus=0&aperture=0"  # as a link copied from the page
    context = browser.new_context()
    bodies = []
    context.on("request", lambda each: bodies.append(each.post_data or ""))
    page, problems = open_page(context, address, FILES["embed.html"].read_text(), answers)
    wait_for_rest(page)
    page.locator("[role=status]", has_text="View 3.0, 0.0").wait_for()
    fields = dict(re.findall(r'name="(\w+)"\r\n\r\n(.*)\r', "".join(bodies)))
    assert fields == (sent and sent | {"model": "none", "views": "all", "format": "tiles"})
    assert problems == []
    context.close()
