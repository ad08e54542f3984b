"""The page in a browser, on a real server with real networks."""

import io
import os
import re
import zipfile

import numpy as np
import pytest
from playwright.sync_api import expect

from ciir.renderer.readers.pictures import decode
from tests.support.browser import needs_browser, read_canvas
from tests.support.browser.page import (
    choose,
    go_to,
    hold_posts,
    open_scene,
    set_field,
    wait_for_picture,
    wait_for_rest,
)
from tests.support.inputs import CUBE, EIA_PNG

pytestmark = needs_browser
AROUND = "#scene=vase&lenses=40x40&pixels=5x5"


def test_a_shipped_scene_is_one_click_away(page):
    page.evaluate("""() => {
        const frame = document.querySelector("#frame");
        window.sizes = [];
        const look = () => sizes.push(...[...frame.querySelectorAll("img")].map((each) => each.naturalWidth));
        new MutationObserver(look).observe(frame, { childList: true });
    }""")
    page.get_by_role("link", name="Vase").click()
    page.locator("#frame canvas").wait_for()
    assert page.evaluate("sizes") == [100]  # the centre view as mapped first
    expect(page.get_by_role("heading", name="Vase")).to_be_focused()
    page.get_by_role("radio", name="Upscaled").check()
    wait_for_picture(page, 200, 200)
    expect(page.locator("#status")).to_contain_text("Done in")


def test_a_mesh_is_shown_and_turned(page):
    choose(page, ("cube.off", CUBE))
    expect(page.locator("#kind")).to_have_text("A mesh")
    set_field(page, "lenses", "20x20")
    wait_for_picture(page, 40, 40)
    before = page.locator("#frame img").screenshot()
    page.locator("[name=yaw]").focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    page.wait_for_url("**rotate=5%2C0%2C0**")
    expect(page.locator("#status")).to_contain_text("Done in")
    wait_for_picture(page, 40, 40)
    assert page.locator("#frame img").screenshot() != before


def test_what_is_being_typed_is_not_taken(page):
    choose(page, ("cube.off", CUBE))
    expect(page.locator("#kind")).to_have_text("A mesh")
    page.locator("[name=lenses]").fill("20x30")
    expect(page.locator("[name=pixels]")).to_have_value("7x7")
    page.locator("[name=pixels]").fill("5")  # no number of pixels: the server would refuse it
    wait_for_picture(page, 40, 60)
    page.keyboard.type("x5")
    page.keyboard.press("Enter")
    page.wait_for_url("**pixels=5x5**")


def test_an_elemental_image_array_asks_for_its_lenses(page):
    choose(page, ("eia.png", EIA_PNG))
    expect(page.locator("#status")).to_contain_text("How many lenses")
    expect(page.locator("[name=lenses]")).to_be_focused()
    set_field(page, "lenses", "6x9")
    wait_for_picture(page, 12, 18)
    page.get_by_role("radio", name="As mapped").check()
    wait_for_picture(page, 6, 9)


def test_the_lenses_of_an_elemental_image_array_are_found(page, server):
    form = {"scene": "vase", "lenses": "60x60", "pixels": "10x10", "background": "ffffff"}
    choose(page, ("vase.png", page.request.post(f"{server}/v1/elementals", multipart=form).body()))
    wait_for_picture(page, 120, 120)
    expect(page.locator("#kind")).to_have_text("An elemental image array")
    pixels = page.locator("[name=pixels]")
    expect(pixels).to_have_value("10x10")
    set_field(page, "lenses", "120x120")  # the guess is wrong
    wait_for_picture(page, 240, 240)
    expect(pixels).to_have_value("")


@pytest.mark.parametrize("typed", ["20", " 20\u00d720", "20 X 20 "])
def test_a_number_of_lenses_is_completed(page, typed):
    open_scene(page)
    set_field(page, "lenses", typed)
    wait_for_picture(page, 40, 40)
    expect(page.locator("[name=lenses]")).to_have_value("20x20")


def test_zips_are_as_python_reads_them(page):
    script = """import('/assets/input/zip.js').then(async ({ writeZip }) => {
        const zip = await writeZip([
            { name: 'a/\u00fc.txt', file: new Blob(['one']) },
            { name: 'b', file: new Blob([]) },
        ]);
        return [...new Uint8Array(await zip.arrayBuffer())];
    })"""
    archive = zipfile.ZipFile(io.BytesIO(bytes(page.evaluate(script))))
    assert archive.testzip() is None
    assert {name: archive.read(name) for name in archive.namelist()} == {"a/\u00fc.txt": b"one", "b": b""}


def test_a_bad_file_is_explained_in_plain_words(page):
    page.expected, name = ["415"], "<img src=x onerror=alert(1)>.obj"
    choose(page, (name, b"hello\n"))
    problem = page.get_by_role("alert")
    expect(problem).to_contain_text("The server can't read this file")
    expect(problem).to_contain_text(f"{name}: the content is text, not OBJ")
    expect(page.locator("#name")).to_have_text(name)
    assert page.locator("img[src=x]").count() == 0
    expect(page.locator("#kind")).to_be_empty()
    expect(page.locator("#settings")).to_be_hidden()  # until there is something that can be made
    choose(page, ("cube.off", CUBE))
    expect(page.locator("#settings")).to_be_visible()


def test_an_error_names_the_file_once(page):
    page.expected, name = ["422"], "vase_qs8x6a0.75.png"
    choose(page, (name, EIA_PNG[:-20]))
    expect(page.locator("#problem-detail")).to_have_text(re.compile(rf"^{re.escape(name)}: the "))


def test_an_invalid_setting_is_marked(page):
    open_scene(page)
    page.expected = ["422"]
    set_field(page, "lenses", "0x5")
    expect(page.get_by_role("alert")).to_contain_text("does not fit")
    expect(page.locator("[name=lenses]")).to_have_attribute("aria-invalid", "true")
    set_field(page, "lenses", "10x10")
    wait_for_picture(page, 20, 20)
    expect(page.get_by_role("alert")).to_be_hidden()


def test_an_error_is_gone_once_a_picture_that_was_made_before_is_shown(page):
    open_scene(page)
    page.expected = ["422"]
    set_field(page, "lenses", "0x5")
    expect(page.get_by_role("alert")).to_be_visible()
    set_field(page, "lenses", "20x30")
    expect(page.locator("#status")).to_contain_text("Done in")
    expect(page.get_by_role("alert")).to_be_hidden()
    expect(page.locator("[aria-invalid]")).to_have_count(0)


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


def test_a_link_keeps_what_a_slider_cannot_have(page):
    with page.expect_request("**/v1/reconstructions") as posted:
        go_to(page, "#scene=vase&lenses=20x30&pixels=3x3&rotate=200,0.5,0&zoom=4&show=mapped")
    wait_for_picture(page, 20, 30)
    for field in ('name="rotate"\r\n\r\n200,0.5,0', 'name="zoom"\r\n\r\n4'):
        assert field in posted.value.post_data
    page.wait_for_url("**rotate=200%2C0.5%2C0&zoom=4&**")
    expect(page.locator("label:has([name=yaw]) .value")).to_have_text("200°")
    page.locator("[name=zoom]").press("ArrowRight")
    page.wait_for_url("**rotate=200%2C0.5%2C0**zoom=1.1**")
    page.locator("[name=yaw]").press("ArrowRight")
    page.wait_for_url("**rotate=1%2C0%2C0**")


def test_a_scale_that_the_network_does_not_have_is_refused(page):
    page.expected = ["422"]
    go_to(page, "#scene=vase&lenses=20x30&pixels=3x3&scale=4")
    expect(page.get_by_role("alert")).to_contain_text("scale: ")
    page.locator("[name=model]").select_option("bicubic")
    wait_for_picture(page, 80, 120)


def test_the_settings_of_a_file_survive_a_reload(page):
    choose(page, ("eia.png", EIA_PNG))
    expect(page.locator("[name=lenses]")).to_be_focused()
    set_field(page, "lenses", "6x9")
    wait_for_picture(page, 12, 18)
    page.reload()
    expect(page.locator("#again")).to_have_text("Choose eia.png again; its settings are kept.")
    choose(page, ("eia.png", EIA_PNG))
    wait_for_picture(page, 12, 18)


def test_where_the_time_went_is_shown(page):
    open_scene(page)
    page.get_by_text("Where the time went").click()
    expect(page.locator("#times")).to_contain_text("Upscaling")
    expect(page.locator("#remarks")).to_contain_text("model auto")


def test_recent_jobs_are_listed_and_opened(page):
    open_scene(page)
    page.get_by_role("button", name="Another file").click()
    expect(page.get_by_role("heading", name="Look around")).to_be_visible()
    expect(page.locator("#files")).to_be_focused()
    page.get_by_role("button", name="Vase: upscaled, 20x30 lenses, 5x5 pixels").click()
    wait_for_picture(page, 40, 60)
    expect(page.locator("#name")).to_be_focused()


def test_recent_jobs_outlive_the_tab_until_they_are_forgotten(page):
    open_scene(page)
    for name in ("view/webp", "view/jpeg"):
        page.locator("#format").select_option(name)
        with page.expect_download():
            page.get_by_role("button", name="Download").click()
    other = page.context.new_page()
    page.close()
    other.goto(page.url.partition("#")[0])
    listed = other.locator("#recent-list button span")
    details = "20x30 lenses, 5x5 pixels"
    expect(listed).to_have_text(
        [
            f"Vase: export, the centre view, JPEG, {details}",
            f"Vase: export, the centre view, WebP, {details}",
            f"Vase: upscaled, {details}",
        ]
    )
    with other.expect_download() as download:
        listed.first.click()
    assert download.value.suggested_filename == "Vase_view.jpg"
    other.get_by_role("button", name="Forget these").click()
    expect(other.locator("#recent")).to_be_hidden()
    other.reload()
    expect(other.locator("#recent")).to_be_hidden()


@pytest.mark.parametrize(
    "kept", ["none", '{"of": "another page"}', "[null]", '[{"url": "/of/an/older/page", "name": "a"}]']
)
def test_recent_jobs_of_another_form_are_left_out(page, kept):
    page.evaluate("kept => localStorage.setItem('recent', kept)", kept)
    page.reload()
    open_scene(page)
    expect(page.locator("#recent-list button")).to_have_count(1)


def test_a_file_that_has_changed_has_to_be_chosen_again_once_the_server_keeps_it_no_more(page, server, tmp_path):
    page.expected = ["ERR_UPLOAD_FILE_CHANGED", "410"]
    path = tmp_path / "cube.off"
    path.write_bytes(CUBE)
    with page.expect_response("**/v1/files") as sent:
        page.locator("#files").set_input_files(path)
    wait_for_picture(page, 200, 200)
    os.utime(path, (0, 0))
    set_field(page, "lenses", "10x15")
    wait_for_picture(page, 20, 30)
    assert page.request.delete(f"{server}/v1/files/{sent.value.json()['id']}").ok
    set_field(page, "lenses", "20x30")
    expect(page.get_by_role("alert")).to_contain_text("was changed or removed")


def test_the_focus_is_not_lost_with_what_had_it(page):
    page.expected = ["ERR_FAILED"]
    open_scene(page)
    page.route("**/v1/reconstructions", lambda route: route.abort())
    set_field(page, "lenses", "21x30")
    again = page.get_by_role("button", name="Try again")
    again.press("Enter")
    expect(page.locator("#name")).to_be_focused()
    expect(again).to_be_visible()
    page.unroute_all()
    hold_posts(page, "reconstructions")
    again.press("Enter")
    page.get_by_role("button", name="Cancel").press("Enter")
    expect(again).to_be_focused()
    page.unroute_all()
    again.press("Enter")
    wait_for_picture(page, 42, 60)
    expect(page.locator("#name")).to_be_focused()


def test_what_is_chosen_is_seen_in_forced_colours(page):
    page.emulate_media(forced_colors="active")
    open_scene(page)
    labels = [decode(label.screenshot(), name="label") for label in page.locator(".modes label:visible").all()]
    backgrounds = [tuple(label[4, label.shape[1] // 2]) for label in labels]
    assert len(backgrounds) == 4
    assert len(set(backgrounds)) == 2


def tab_to(page, target):
    """Presses Tab until `target` has the focus."""
    for _ in range(60):
        page.keyboard.press("Tab")
        if target.evaluate("each => each === document.activeElement"):
            return
    pytest.fail(f"Tab does not reach {target}")


def test_everything_works_by_keyboard(page):
    page.on("filechooser", lambda _: None)  # from here on Chromium hands choosers over: the next line alone is too late
    tab_to(page, page.locator("#files"))
    with page.expect_file_chooser() as chooser:
        page.keyboard.press("Enter")
    chooser.value.set_files({"name": "cube.off", "mimeType": "", "buffer": CUBE})
    expect(page.locator("#kind")).to_have_text("A mesh")
    wait_for_picture(page, 200, 200)
    for name, value in (("lenses", "20x30"), ("pixels", "5x5")):
        tab_to(page, page.locator(f"[name={name}]"))
        page.keyboard.type(value)
    page.keyboard.press("Tab")
    wait_for_picture(page, 40, 60)
    tab_to(page, page.locator("[name=yaw]"))
    page.keyboard.press("PageUp")
    page.wait_for_url("**rotate=**")
    tab_to(page, page.locator("[name=show]:checked"))
    page.keyboard.press("ArrowRight")
    for name in ("Disparity", "EPI"):
        page.get_by_role("checkbox", name=name).wait_for()
        tab_to(page, page.get_by_role("checkbox", name=name))
        page.keyboard.press("Space")
    page.get_by_alt_text("The disparity of the centre view").wait_for()
    tab_to(page, page.get_by_label("Row of the EPI"))
    tab_to(page, page.locator("summary"))
    page.keyboard.press("Enter")
    expect(page.locator("#times")).to_be_visible()
    tab_to(page, page.get_by_role("button", name="Download"))
    with page.expect_download() as download:
        page.keyboard.press("Enter")
    assert download.value.suggested_filename == "cube_view.png"
    tab_to(page, page.get_by_role("button", name="Another file"))
    page.keyboard.press("Enter")
    tab_to(page, page.get_by_role("link", name="Vase"))
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Vase")).to_be_visible()


def test_each_way_of_moving_shows_other_pixels(browser, server):
    context = browser.new_context(has_touch=True)  # a device that may say how it is held
    page = context.new_page()
    page.goto(f"{server}/{AROUND}&show=around")
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


@pytest.mark.parametrize("model", ["none", "bicubic&scale=3"])
def test_the_disparity_in_focus_is_that_of_the_server(page, server, model):
    form = {"scene": "vase", "lenses": "80x80", "pixels": "7x7"}
    found = page.request.post(f"{server}/v1/disparities", multipart=form | {"format": "npy"}).body()
    expected = np.load(io.BytesIO(found))[56, 40]
    assert expected < -0.6  # behind the lenses
    address = "&".join(f"{name}={value}" for name, value in form.items())
    go_to(page, f"#{address}&show=around&model={model}&focus=0.25")
    page.get_by_role("checkbox", name="Disparity").wait_for()
    page.locator("#format").select_option("plane/png")
    field = page.locator("#export-form [name=disparity]")
    expect(field).to_have_value("0.25")
    box = page.locator("canvas").bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.7 * box["height"])
    expect(field).not_to_have_value("0.25")
    assert float(field.input_value()) == pytest.approx(expected, abs=0.15)
    assert f"focus={field.input_value()}&" in page.url
    field.fill("-1")
    page.locator("canvas").press("ArrowRight")
    wait_for_rest(page)
    expect(field).to_have_value("-1")  # the user's


def test_networks_are_compared_with_the_truth(page):
    go_to(page, f"{AROUND}&show=compare")
    status = page.locator(".comparison [role=status]")
    left = page.get_by_label("Picture on the left")
    shown = {}
    for name in ("As mapped", "Bicubic", "Upscaled", "fast"):
        left.select_option(name)
        status.filter(has_text=f"{name}:").wait_for()
        shown[name] = re.search(r": ([\d.]+) dB, SSIM ([\d.]+)", status.text_content()).groups()
    assert 20 < float(shown["As mapped"][0]) < float(shown["Upscaled"][0]) < 60, shown
    assert 0.5 < float(shown["As mapped"][1]) < float(shown["Upscaled"][1]) <= 1, shown
    left.select_option("Rendered at the larger size")
    status.locator("span", has_text=re.compile("size$")).wait_for()
