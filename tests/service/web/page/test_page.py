"""The page in a browser, on a real server with real networks."""

import io
import json
import zipfile

import numpy as np
import pytest
from playwright.sync_api import expect

from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.options import KINDS
from tests.support.browser import needs_browser
from tests.support.inputs import CUBE, EIA_PNG, make_picture

pytestmark = needs_browser
OTHERS = ("inspection", "upscale")  # kinds of jobs whose results are nothing of a light field to keep


def choose(page, *files):
    """Chooses files, `(name, bytes)`."""
    listed = [{"name": name, "mimeType": "", "buffer": data} for name, data in files]
    page.locator("#files").set_input_files(listed)


def wait_for_picture(page, height, width):
    """Waits until the page shows a picture of that size."""
    page.wait_for_function(
        "([h, w]) => { const found = document.querySelector('#frame img');"
        " return found && found.naturalHeight === h && found.naturalWidth === w; }",
        arg=[height, width],
    )


def set_field(page, name, value):
    """Fills a setting in, and leaves it."""
    page.locator(f"#settings [name={name}]").fill(value)
    page.locator(f"#settings [name={name}]").press("Tab")


def open_scene(page, lenses="20x30"):
    """Opens the vase with fewer lenses than usual."""
    page.goto(f"{page.url.partition('#')[0]}#scene=vase&lenses={lenses}&pixels=5x5")
    height, width = map(int, lenses.split("x"))
    wait_for_picture(page, 2 * height, 2 * width)


def test_a_shipped_scene_is_one_click_away(page):
    page.get_by_role("button", name="Vase").click()
    wait_for_picture(page, 100, 100)
    wait_for_picture(page, 200, 200)
    expect(page.get_by_role("heading", name="Vase")).to_be_visible()
    expect(page.get_by_role("status")).to_contain_text("Done in")


def test_a_mesh_is_shown_and_turned(page):
    choose(page, ("cube.off", CUBE))
    expect(page.locator("#kind")).to_have_text("A mesh")
    set_field(page, "lenses", "20x20")
    wait_for_picture(page, 40, 40)
    before = page.locator("#frame img").screenshot()
    page.locator("[name=yaw]").focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    page.wait_for_url("**rotate=25%2C0%2C0**")
    expect(page.get_by_role("status")).to_contain_text("Done in")
    wait_for_picture(page, 40, 40)
    assert page.locator("#frame img").screenshot() != before


def test_an_elemental_image_array_asks_for_its_lenses(page):
    choose(page, ("eia.png", EIA_PNG))
    expect(page.get_by_role("status")).to_contain_text("How many lenses")
    expect(page.locator("[name=lenses]")).to_be_focused()
    set_field(page, "lenses", "6x9")
    wait_for_picture(page, 12, 18)
    page.get_by_role("radio", name="As mapped").check()
    wait_for_picture(page, 6, 9)


def test_the_lenses_of_an_elemental_image_array_are_found(page, server):
    form = {"scene": "vase", "lenses": "60x60", "pixels": "10x10", "background": "ffffff"}
    choose(page, ("vase.png", page.request.post(f"{server.url}/v1/elementals", multipart=form).body()))
    wait_for_picture(page, 120, 120)
    expect(page.locator("#kind")).to_have_text("An elemental image array")
    expect(page.locator("[name=pixels]")).to_have_value("10x10")


def test_several_views_travel_as_one_zip(page):
    views = [
        (f"view_{v:02d}_{u:02d}.png", encode_png(make_picture(8, 10, seed=3 * v + u)))
        for v in range(3)
        for u in range(3)
    ]
    choose(page, *reversed(views))
    wait_for_picture(page, 16, 20)


def test_zips_are_as_python_reads_them(page):
    script = """import('/assets/zip.js').then(async ({ writeZip }) => {
        const zip = await writeZip([
            { name: 'a/\u00fc.txt', file: new Blob(['one']) },
            { name: 'b', file: new Blob([]) },
        ]);
        return [...new Uint8Array(await zip.arrayBuffer())];
    })"""
    archive = zipfile.ZipFile(io.BytesIO(bytes(page.evaluate(script))))
    assert archive.testzip() is None
    assert {name: archive.read(name) for name in archive.namelist()} == {"a/\u00fc.txt": b"one", "b": b""}


@pytest.mark.parametrize("name", ["bad.obj", "<img src=x onerror=alert(1)>.obj"])
def test_a_bad_file_is_explained_in_plain_words(page, name):
    page.expected = ["415"]  # the second of two that are alike fails at once
    choose(page, (name, b"hello\n"))
    problem = page.get_by_role("alert")
    expect(problem).to_contain_text("no file that the server can read")
    expect(problem).to_contain_text(f"{name}: text, which is no OBJ")
    expect(page.locator("#name")).to_have_text(name)
    assert page.locator("img[src=x]").count() == 0


def test_an_invalid_setting_is_marked(page):
    open_scene(page)
    page.expected = ["422"]
    set_field(page, "lenses", "0x5")
    expect(page.get_by_role("alert")).to_contain_text("does not fit")
    expect(page.locator("[name=lenses]")).to_have_attribute("aria-invalid", "true")
    set_field(page, "lenses", "10x10")
    wait_for_picture(page, 20, 20)
    expect(page.get_by_role("alert")).to_be_hidden()


def test_a_link_shows_the_same_picture(page, browser):
    open_scene(page)
    page.locator("[name=model]").select_option("bicubic")
    page.locator("[name=scale]").select_option("3")
    wait_for_picture(page, 60, 90)
    picture = page.locator("#frame img").screenshot()
    context = browser.new_context()
    other = context.new_page()
    other.goto(page.url)
    wait_for_picture(other, 60, 90)
    assert other.locator("#frame img").screenshot() == picture
    other.reload()
    wait_for_picture(other, 60, 90)
    expect(other.locator("[name=scale]")).to_have_value("3")
    context.close()


def test_the_settings_of_a_file_survive_a_reload(page):
    choose(page, ("eia.png", EIA_PNG))
    expect(page.locator("[name=lenses]")).to_be_focused()
    set_field(page, "lenses", "6x9")
    wait_for_picture(page, 12, 18)
    page.reload()
    expect(page.locator("#again")).to_have_text("Choose eia.png again; its settings are kept.")
    choose(page, ("eia.png", EIA_PNG))
    wait_for_picture(page, 12, 18)


def test_a_job_is_followed_and_cancelled(page):
    page.expected = ["409"]
    open_scene(page, "150x150")
    page.locator("#format").select_option("all/npz")
    page.get_by_role("button", name="Download").click()
    expect(page.locator("#job")).to_be_visible()
    with page.expect_response(lambda response: response.request.method == "DELETE") as deleted:
        page.get_by_role("button", name="Cancel").click()
    assert page.request.get(deleted.value.url).json()["state"] == "cancelled"
    expect(page.locator("#job")).to_be_hidden()
    expect(page.get_by_role("status")).to_have_text("Cancelled.")


def test_where_the_time_went_is_shown(page):
    open_scene(page)
    page.get_by_text("Where the time went").click()
    expect(page.locator("#times")).to_contain_text("Upscaling")
    expect(page.locator("#remarks")).to_contain_text("model auto")


def test_recent_jobs_are_listed_and_opened(page):
    open_scene(page)
    page.get_by_role("button", name="Another file").click()
    expect(page.get_by_role("heading", name="Look around")).to_be_visible()
    page.get_by_role("button", name="Vase: upscaled").click()
    wait_for_picture(page, 40, 60)
    assert page.evaluate("localStorage.length") == 0


def test_every_format_of_the_server_is_offered(page):
    open_scene(page)
    script = "import('/assets/export.js').then(({ EXPORTS }) => Object.values(EXPORTS).map((g) => [g.kind, g.formats]))"
    offered = {(kind, format_) for kind, formats in page.evaluate(script) for format_ in formats}
    written = {(kind.plural, format_) for kind in KINDS.values() if kind.name not in OTHERS for format_ in kind.formats}
    assert offered == written


def test_a_download_holds_what_it_says(page):
    open_scene(page)
    for format_, name in (
        ("all/npz", "vase.npz"),
        ("displays/quilt", "vase_qs11x6a0.5625.png"),
        ("disparities/pfm", "vase.pfm"),
    ):
        page.locator("#format").select_option(format_)
        with page.expect_download() as download:
            page.get_by_role("button", name="Download").click()
        assert download.value.suggested_filename == name
        data = download.value.path().read_bytes()
        if name.endswith(".npz"):
            with np.load(io.BytesIO(data)) as arrays:
                assert arrays["views"].shape == (25, 40, 60, 3)
                assert json.loads(str(arrays["report"]))["plan"]["scale"] == 2
        elif name.endswith(".png"):
            assert decode(data, name=name).ndim == 3
        else:
            assert data.startswith(b"Pf")


def test_everything_works_by_keyboard(page):
    order = []
    for _ in range(4):
        page.keyboard.press("Tab")
        order.append(page.evaluate("document.activeElement.id || document.activeElement.textContent"))
    assert order == ["files", "folder", "Vase", "Globe"]
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Globe")).to_be_visible()
    wait_for_picture(page, 200, 200)
    page.locator("[name=show]:checked").focus()
    page.keyboard.press("ArrowLeft")
    wait_for_picture(page, 100, 100)


def test_one_looks_around_in_a_light_field(page):
    open_scene(page)
    page.get_by_role("radio", name="Look around").check()
    canvas = page.locator("#frame canvas")
    expect(canvas).to_be_visible()
    expect(page.locator("#status")).to_contain_text("Done in")
    before = canvas.screenshot()
    canvas.focus()
    for _ in range(4):
        page.keyboard.press("ArrowRight")
    page.wait_for_url("**&u=0**")
    assert canvas.screenshot() != before
    page.get_by_role("radio", name="As mapped").check()
    wait_for_picture(page, 20, 30)


def test_ways_to_upscale_are_compared(page):
    open_scene(page)
    page.get_by_role("radio", name="Compare").check()
    expect(page.locator("#frame [role=status]")).to_contain_text("dB")
    names = page.locator("#frame [name=right] option").all_text_contents()
    assert names == ["As mapped", "Bicubic", "Upscaled"]
