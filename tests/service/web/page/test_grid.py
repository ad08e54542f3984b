"""The lens grid over a picture, with a real server: found, drawn, and dragged right."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from ciir.renderer.readers.lenslet.grid import LensGrid
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode, encode_png
from tests.support.browser import needs_browser
from tests.support.browser.page import choose, set_field
from tests.support.inputs import EIA_PNG
from tests.support.lenslet.camera import make_camera, take_picture

pytestmark = [needs_browser, pytest.mark.slow]
SIZE = 300, 360
GRIDS = {
    "square": LensGrid(12.6, (5.3, 6.8), -0.5, "square"),
    "hexagonal": LensGrid(14.37, (5.3, 8.8), 0.8, "hexagonal"),
    "hexagonal-columns": LensGrid(14.37, (5.3, 8.8), 0.8, "hexagonal"),
}
CENTERS = """async ([settings, size, lenses]) => {
    const { findCentre, findLens, readGrid } = await import("/assets/input/lenses.js");
    const grid = readGrid(settings, size);
    return lenses.map((lens) => ({ place: findCentre(grid, lens), lens: findLens(grid, findCentre(grid, lens)) }));
}"""


@pytest.fixture
def eia(page):
    """An elemental image array of 60x60 lenses of 10x10 pixels, of the vase."""
    form = {"scene": "vase", "lenses": "60x60", "pixels": "10x10", "background": "ffffff"}
    return page.request.post(f"{page.url}v1/elementals", multipart=form).body()


def open_grid(page, name, data, view):
    """Opens a picture, shows its lens grid, and waits for the centre view of so many rows and columns."""
    choose(page, (name, data))
    expect(page.locator("#kind")).not_to_have_text("Reading the file")
    page.get_by_role("radio", name="Lens grid").check()
    wait_for_view(page, *view)


def wait_for_view(page, rows, cols):
    """Waits for the mapped view."""
    script = """([h, w]) => {
        const view = document.querySelector('.view');
        return view && view.naturalHeight === h && view.naturalWidth === w;
    }"""
    page.wait_for_function(script, arg=[rows, cols])


def read_field(page, name):
    """The numbers in a field."""
    return [float(text) for text in re.split("[,x]", page.locator(f"#settings [name={name}]").input_value())]


def drag(page, label, down, right):
    """Drags a handle by pixels of the picture."""
    handle, frame = page.get_by_role("button", name=label), page.locator(".lens-grid .pictures")
    scale = frame.bounding_box()["width"] / SIZE[1]
    box = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right * scale / 2, y + down * scale / 2)
    page.mouse.move(x + right * scale, y + down * scale)
    page.mouse.up()


@pytest.mark.parametrize("shape", GRIDS)
def test_lenses_lie_where_the_reader_has_them(page, shape):
    grid, in_columns = GRIDS[shape], shape == "hexagonal-columns"
    lenses = [(0, 0), (1, 0), (4, 7), (-3, 2)]
    offset, rotation = (grid.offset[::-1], -grid.rotation) if in_columns else (grid.offset, grid.rotation)
    settings = {
        "lens_pitch": str(grid.pitch),
        "lens_offset": "{},{}".format(*offset),
        "lens_rotation": str(rotation),
        "lens_grid": shape,
    }
    found = page.evaluate(CENTERS, [settings, SIZE, lenses])
    i, j = np.array(lenses).T
    expected = grid.find_centers(i, j) + 0.5  # the reader counts from the centre of a pixel
    np.testing.assert_allclose([each["place"] for each in found], expected[:, ::-1] if in_columns else expected)
    assert [tuple(each["lens"]) for each in found] == lenses


@pytest.mark.parametrize("shape", GRIDS)
def test_the_grid_of_a_raw_picture_is_found_and_dragged(page, shape):
    picture = np.asarray(take_picture(make_camera("vase", GRIDS[shape], SIZE)), np.uint8)
    if shape == "hexagonal-columns":
        picture = np.ascontiguousarray(picture.swapaxes(0, 1))
    choose(page, ("raw.png", encode_png(picture)))
    expect(page.locator("#kind")).to_have_text("A raw lenslet picture")
    page.get_by_role("radio", name="Lens grid").check()
    expect(page.locator(".view")).to_be_visible()
    expect(page.locator("[name=lenses]")).to_be_hidden()
    before = {name: read_field(page, name) for name in ("lens_pitch", "lens_offset", "lens_rotation")}
    assert before["lens_rotation"] == [round(each, 4) for each in before["lens_rotation"]]
    assert before["lens_pitch"][0] == pytest.approx(GRIDS[shape].pitch, abs=0.01)

    move = page.get_by_role("button", name="Place of the lens grid")
    move.press("ArrowRight")
    move.press("ArrowDown")
    move.press("ArrowDown")
    after = read_field(page, "lens_offset")
    grid = GRIDS[shape]
    # The offset is now that of the handle's lens: off the old grid by as much as the keys moved it, (0.4, 0.2).
    y, x = after[0] - 0.4, after[1] - 0.2
    old = [*before["lens_offset"]], before["lens_rotation"][0], before["lens_pitch"][0]
    exchange = slice(None, None, -1) if shape == "hexagonal-columns" else slice(None)
    known = LensGrid(old[2], tuple(old[0][exchange]), -old[1] if shape == "hexagonal-columns" else old[1], grid.shape)
    nearest = known.find_centers(*known.find_nearest(np.array([y, x])[exchange]))[exchange]
    np.testing.assert_allclose(nearest, (y, x), atol=0.02)  # fields have two digits
    page.wait_for_url("**lens_offset=**")

    drag(page, "Pitch and rotation", 4, 4)
    assert read_field(page, "lens_pitch")[0] > before["lens_pitch"][0] + 0.05
    expect(page.locator(".lens-grid p")).to_contain_text(f"{read_field(page, 'lens_pitch')[0]:.3f} pixels")
    expect(page.get_by_role("alert")).to_be_hidden()


def test_the_grid_of_an_elemental_image_array_is_dragged(page, eia):
    open_grid(page, "eia.png", eia, (60, 60))
    corner, found = page.get_by_role("button", name="Corner of an elemental image"), page.locator("#grids")
    expect(page.locator(".lens-grid")).to_contain_text("Drag the ring")
    expect(found).to_have_value("0")
    corner.press("ArrowRight")
    expect(page.locator("[name=pixels]")).to_have_value("10x12")
    expect(found).to_have_value("")  # none of those that were found
    wait_for_view(page, 60, 50)
    corner.press("ArrowUp")
    corner.press("ArrowLeft")
    wait_for_view(page, 75, 60)
    box = corner.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + 60)
    page.mouse.up()
    rows, cols = read_field(page, "pixels")
    assert rows > 8
    assert (600 % rows, cols) == (0, 10)
    wait_for_view(page, 600 // int(rows), 60)
    set_field(page, "pixels", "10x10")
    wait_for_view(page, 60, 60)
    expect(found).to_have_value("0")
    expect(page.locator(".lens-grid p")).to_contain_text("60x60 lenses of 10x10 pixels")


def test_single_lenses_are_seen_when_one_zooms_in(page, eia):
    open_grid(page, "eia.png", eia, (60, 60))
    width = page.locator("#lenses").get_attribute("width")
    page.locator(".lens-grid .pictures").focus()
    for _ in range(6):
        page.keyboard.press("+")
    box, frame = page.locator(".handle:visible").bounding_box(), page.locator(".lens-grid .pictures").bounding_box()
    assert page.locator("#lenses").get_attribute("width") == "10"
    assert float(width) in (10, 20)
    assert frame["x"] < box["x"] < frame["x"] + frame["width"]
    assert frame["y"] < box["y"] < frame["y"] + frame["height"]


def test_a_picture_without_lenses_is_shown_to_find_them(page):
    choose(page, ("eia.png", EIA_PNG))
    expect(page.locator("#status")).to_contain_text("How many lenses")
    expect(page.locator(".lens-grid .pictures img")).to_be_visible()
    page.get_by_role("button", name="Corner of an elemental image").press("ArrowLeft")
    page.wait_for_url("**pixels=**")
    expect(page.locator("#frame > img")).to_be_visible()


def test_a_picture_that_the_browser_cannot_read_comes_from_the_server(page, eia):
    open_grid(page, "eia.tiff", encode(decode(eia, name="eia"), ".tiff"), (60, 60))
    size = page.locator(".layer img").evaluate("image => [image.naturalHeight, image.naturalWidth]")
    assert size == [600, 600]
