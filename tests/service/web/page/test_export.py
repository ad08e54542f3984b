"""What the page downloads, opened by the library that reads it."""

import io
import json
import re
import zipfile

import av
import h5py
import numpy as np
import pytest
import scipy.io
import tifffile
import trimesh
from PIL import Image
from playwright.sync_api import expect

from ciir.models.catalogue import list_names
from ciir.renderer.displays.devices import DEVICES
from ciir.renderer.displays.integral import parse_display
from ciir.renderer.displays.lenticular import parse_calibration
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.options import KINDS
from ciir.service.pipeline.options.kinds import FILE_TYPES
from tests.support.browser import needs_browser
from tests.support.browser.page import (
    check_progress,
    choose,
    choose_mode,
    go_to,
    hold_posts,
    open_scene,
    set_field,
    wait_for_picture,
)
from tests.support.displays import CALIBRATION
from tests.support.inputs import CUBE, EIA_PNG, make_picture
from tests.support.meshes.gltf import Model

pytestmark = [needs_browser, pytest.mark.slow]
OTHERS = ("inspection", "upscale")  # kinds of jobs whose results are nothing of a light field to keep
SIZE = 24, 36, 3


def open_picture(data):
    """`(H, W, C)` of a picture, of all its frames."""
    with Image.open(io.BytesIO(data)) as picture:
        frames = getattr(picture, "n_frames", 1)
        shape = np.asarray(picture.convert("RGB")).shape
    return shape if frames == 1 else (frames, *shape)


def open_video(data):
    with av.open(io.BytesIO(data)) as video:
        return np.stack([frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]).shape[1:]


def open_npz(data):
    with np.load(io.BytesIO(data)) as arrays:
        assert json.loads(str(arrays["report"]))["plan"]["scale"] == 2
        return arrays["views"].shape


def open_hdf5(data):
    with h5py.File(io.BytesIO(data)) as file:
        return file["LF"].shape


def open_mesh(data):
    return len(trimesh.load(io.BytesIO(data), file_type="glb", force="mesh").faces) > 100


# Of views of 24x36 pixels, 3x3: the end of the name, what opens the file, and what it then has.
FILES = {
    "view/tiff": ("_view.tif", lambda data: tifffile.imread(io.BytesIO(data)).shape, SIZE),
    "all/zip": ("_views.zip", lambda data: len(zipfile.ZipFile(io.BytesIO(data)).namelist()), 10),
    "all/npz": ("_views.npz", open_npz, (9, *SIZE)),
    "all/eia": ("_views_eia.png", open_picture, (72, 108, 3)),
    "all/mat": ("_views.mat", lambda data: scipy.io.loadmat(io.BytesIO(data))["LF"].shape, (3, 3, *SIZE)),
    "all/hci": ("_views.h5", open_hdf5, (3, 3, *SIZE)),
    "all/mp4": ("_views.mp4", open_video, SIZE),
    "all/gif": ("_views.gif", lambda data: open_picture(data)[1:], SIZE),
    "all epi/epi": ("_views_epi.png", open_picture, (3, 36, 3)),
    "displays lenticular/lenticular": ("_lenticular.png", open_picture, (80, 120, 3)),
    "elementals/jpeg": ("_eia.jpg", open_picture, (36, 54, 3)),
    "plane/png": ("_plane.png", open_picture, SIZE),
    "stack/npy": ("_planes.npy", lambda data: len(np.load(io.BytesIO(data))), 16),
    "disparities/glb": ("_depth.glb", open_mesh, True),
}


def test_a_download_is_what_its_name_says(page):
    go_to(page, "#scene=vase&lenses=12x18&pixels=3x3&model=bicubic&scale=2")
    wait_for_picture(page, *SIZE[:2])
    texts = "groups => groups.map((group) => [...group.children].map((option) => option.textContent))"
    for names in page.locator("#format optgroup").evaluate_all(texts):
        assert len(set(names)) == len(names)
    for format_, (end, read, expected) in FILES.items():
        page.locator("#format").select_option(format_)
        if "lenticular" in format_:
            calibration = {"name": "c.json", "mimeType": "", "buffer": json.dumps(CALIBRATION).encode()}
            page.get_by_label("Calibration").set_input_files(calibration)
        if "epi" in format_:
            page.get_by_label("Row y=120").fill("y=20")
        with page.expect_download() as download:
            page.get_by_role("button", name="Download").click()
        assert download.value.suggested_filename == f"Vase{end}"
        assert (format_, read(download.value.path().read_bytes())) == (format_, expected)
    expect(page.get_by_role("alert")).to_be_hidden()


def test_an_animated_mesh_is_shown_at_a_time_and_exported_at_several(page):
    page.expected = ["422"]
    model = Model()
    model.animate(0, "rotation", [0, 1], np.array([[0, 0, 0, 1], [0, 0.5**0.5, 0, 0.5**0.5]], np.float32))
    go_to(page, "#file=square.glb&lenses=12x18&pixels=3x3&model=none&show=mapped")
    page.reload()
    choose(page, ("square.glb", model.glb()))
    wait_for_picture(page, 12, 18)
    before = page.locator("#frame img").screenshot()
    set_field(page, "time", "0,5")
    problem = page.get_by_role("alert")
    expect(problem).to_contain_text(
        '"The centre view of an animation" or "The centre view on a turntable" under Export'
    )
    expect(problem).to_contain_text("One time has a decimal point, as 0.5")
    set_field(page, "time", "0.5")
    page.wait_for_url("**time=0.5**")
    expect(page.locator("#status")).to_contain_text("Done in")
    assert page.locator("#frame img").screenshot() != before
    page.locator("#format").select_option("times/gif")
    times, button = page.locator("#export-form [name=time]"), page.get_by_role("button", name="Download")
    times.fill("bla")
    button.click()
    expect(times).to_have_attribute("aria-invalid", "true")
    expect(page.locator("#settings [name=time]")).not_to_have_attribute("aria-invalid", "true")
    times.fill("0:1:5")
    with page.expect_download() as download:
        button.click()
    assert download.value.suggested_filename == "square_animation.gif"
    assert open_picture(download.value.path().read_bytes()) == (5, 12, 18, 3)


def test_a_mesh_turns_on_a_turntable(page):
    go_to(page, "#scene=vase&lenses=12x18&pixels=3x3&model=none&rotate=30,20,10&show=mapped")
    wait_for_picture(page, 12, 18)
    page.locator("#format").select_option("turntable/gif")
    yaws = page.get_by_label("Turns to the right")
    expect(yaws).to_have_value("0:360:60")
    yaws.fill("0:360:4")
    with page.expect_request("**/v1/reconstructions") as posted, page.expect_download() as download:
        page.get_by_role("button", name="Download").click()
    assert re.search(r'name="rotate"\r\n\r\n0:360:4,20,10\r', posted.value.post_data)
    assert download.value.suggested_filename == "Vase_turntable.gif"
    assert open_picture(download.value.path().read_bytes()) == (4, 12, 18, 3)


def test_it_says_what_a_file_shows(page):
    open_scene(page)
    for format_, what in (("elementals/png", "Elemental image array of the mesh"), ("disparities/png", "Depth")):
        page.locator("#format").select_option(format_)
        expect(page.locator("#shown")).to_have_text(what)
        with page.expect_download():
            page.get_by_role("button", name="Download").click()
        expect(page.locator("#recent-list button").first).to_contain_text(f"Vase: export, {what.lower()}, PNG")


def test_planes_of_a_mesh_begin_within_it(page, server):
    open_scene(page)
    form = {"scene": "vase", "lenses": "20x30", "pixels": "5x5"}
    url = page.request.post(f"{server}/v1/disparities", multipart=form).headers["content-location"]
    status = page.request.get(f"{server}{url.removesuffix('/result')}").json()
    seen = status["report"]["disparity"]["confident"]
    least, largest = (f"{seen[name]:.2f}".removesuffix("0") for name in ("least", "largest"))
    page.locator("#format").select_option("stack/gif")
    expect(page.locator("[name=stack]")).to_have_value(f"{least}:{largest}:16")
    page.locator("#format").select_option("plane/png")
    expect(page.locator("[name=disparity]")).to_have_value(f"{(seen['least'] + seen['largest']) / 2:.2f}")
    expect(page.locator("#focus-help")).to_be_hidden()


def test_planes_of_a_capture_begin_at_what_is_known_of_it(page):
    choose(page, ("eia.png", EIA_PNG))
    set_field(page, "lenses", "6x9")
    wait_for_picture(page, 12, 18)
    page.locator("#format").select_option("stack/gif")
    expect(page.locator("[name=stack]")).to_have_value("-1:1:16")
    expect(page.locator("#focus-help")).to_contain_text("Show the disparity in Look around")
    found = {"disparity": {"least": -9, "largest": 9, "confident": {"least": 0.25, "largest": 1.5}}}
    page.route("**/v1/disparities", lambda route: route.fulfill(json={"id": "a", "state": "done", "report": found}))
    picture = encode_png(make_picture(6, 9))
    page.route("**/v1/disparities/a/result", lambda route: route.fulfill(body=picture))
    choose_mode(page, "Look around")
    page.get_by_role("checkbox", name="Disparity").check()
    expect(page.locator("[name=stack]")).to_have_value("0.25:1.5:16")
    expect(page.locator("#focus-help")).to_be_hidden()


def test_views_of_a_capture_are_upscaled_for_a_display_if_that_is_chosen(page):
    choose(page, ("eia.png", EIA_PNG))
    set_field(page, "lenses", "6x9")
    wait_for_picture(page, 12, 18)
    page.locator("#format").select_option("displays/quilt")
    sizes = []
    for is_larger in (False, True):
        page.get_by_label("Upscale the views first").set_checked(is_larger)
        with page.expect_download() as download:
            page.get_by_role("button", name="Download").click()
        sizes.append(open_picture(download.value.path().read_bytes())[:2])
    assert sizes[1] == tuple(2 * side for side in sizes[0])
    expect(page.locator("#recent-list button").first).to_contain_text("upscaled")
    open_scene(page)
    page.locator("#format").select_option("displays/quilt")
    expect(page.get_by_label("Upscale the views first")).to_have_count(0)  # a mesh is cast ray by ray


def test_an_exported_viewer_has_the_name_of_the_file(page):
    go_to(page, "#file=a%26b.off&lenses=20x20&pixels=3x3&model=none")
    page.reload()
    choose(page, ("a&b.off", CUBE))
    wait_for_picture(page, 20, 20)
    page.locator("#format").select_option("all/html")
    for button in ("Download", "a&b.off: export"):
        with page.expect_download() as download:
            page.get_by_role("button", name=button).click()
        text = download.value.path().read_text()
        assert "<title>a&amp;b.off</title>" in text
        assert '<h1 class="unseen">a&amp;b.off</h1>' in text
        assert text.rstrip().endswith("</html>")


def test_each_network_says_what_it_is_for(page):
    texts = page.evaluate("import('/assets/texts.js').then(({ MODELS }) => MODELS)")
    assert {"auto", "none", *texts} >= set(list_names())


def test_the_examples_of_files_for_displays_are_read(page):
    texts = page.evaluate("import('/assets/texts.js').then(({ EXAMPLES }) => EXAMPLES)")
    assert parse_calibration(texts["calibration"].encode(), name="a.json").width == 3600
    assert parse_display(texts["display"].encode(), name="a.toml").width == 1920
    open_scene(page)
    page.locator("#format").select_option("displays panel/panel")
    page.locator("#needed summary").click()
    expect(page.locator("#needed pre")).to_have_text(texts["display"])


def test_times_are_offered_for_animations_alone(page):
    still, moving = Model(), Model()
    moving.animate(0, "rotation", [0, 1], np.array([[0, 0, 0, 1], [0, 0.5**0.5, 0, 0.5**0.5]], np.float32))
    for name, data, is_offered in (
        ("b.glb", still.glb(), False),
        ("c.glb", moving.glb(), True),
        ("d.off", CUBE, False),
    ):
        choose(page, (name, data))
        expect(page.locator("#name")).to_have_text(name)
        expect(page.locator("#kind")).to_have_text("A mesh")
        expect(page.locator("#settings [name=time]")).to_be_visible(visible=is_offered)
        expect(page.locator("#format option[value^='times/']")).to_have_count(5 if is_offered else 0)


def test_every_format_of_the_server_is_offered(page):
    groups = "Object.values(EXPORTS).map((group) => [group.kind, group.formats])"
    script = f"import('/assets/results/export.js').then(({{ EXPORTS }}) => {groups})"
    offered = {(kind, format_) for kind, formats in page.evaluate(script) for format_ in formats}
    written = {(kind.plural, format_) for kind in KINDS.values() if kind.name not in OTHERS for format_ in kind.formats}
    assert offered == written


def test_every_looking_glass_is_offered(page):
    assert page.evaluate("import('/assets/results/export.js').then(({ CHOICES }) => CHOICES.device)") == list(DEVICES)
    open_scene(page)
    page.locator("#format").select_option("displays/quilt")
    page.get_by_label("Model of the Looking Glass").select_option("go")
    hold_posts(page, "displays")
    with page.expect_request("**/v1/displays") as posted:
        page.get_by_role("button", name="Download").click()
    assert re.search(r'name="device"\r\n\r\ngo\r', posted.value.post_data)


def test_a_lenticular_print_is_as_large_as_its_size_and_the_printer_say(page):
    page.expected = ["422"]
    open_scene(page)
    page.locator("#format").select_option(label="Lenticular print")
    button = page.get_by_role("button", name="Download")
    for label, value in (("Size of the print", "1x0.5in"), ("Dots per inch", "100"), ("Viewing angle", "50")):
        page.get_by_label(label).fill(value)
    button.click()
    expect(page.get_by_role("alert")).to_contain_text("give dpi 120 or more")
    expect(page.get_by_label("Lenses per inch")).to_have_attribute("aria-invalid", "true")
    page.get_by_label("Dots per inch").fill("150")
    with page.expect_request("**/v1/displays") as posted, page.expect_download() as download:
        button.click()
    sent = dict(re.findall(r'name="(print|lpi|dpi|view_\w+)"\r\n\r\n(.*)\r', posted.value.post_data))
    assert sent == {"print": "1x0.5in", "lpi": "60", "dpi": "150", "view_angle": "50"}
    assert download.value.suggested_filename == "Vase_print.png"
    with Image.open(download.value.path()) as picture:
        assert (picture.size, round(picture.info["dpi"][0])) == ((150, 75), 150)


def test_downloads_of_one_input_have_different_names(page):
    script = """import("/assets/results/export.js").then(({ EXPORTS, nameResult }) => Object.values(EXPORTS).flatMap(
        ({ kind, formats, fields, needs = [] }) => formats.map((format) => [
            nameResult(kind, { ...fields, ...Object.fromEntries(needs.map((need) => [need, "0:1:2"])), format }),
            format])))"""
    names = [end + FILE_TYPES[format_].suffix for end, format_ in page.evaluate(script)]
    assert sorted(set(names)) == sorted(names)


def test_a_name_keeps_the_layout_of_a_quilt_and_nothing_of_a_path(page):
    save = """([stem, sent]) => import("/assets/results/export.js").then(({ saveResponse }) => saveResponse(
        new Response("", { headers: { "Content-Disposition": `attachment; filename="0f1e${sent}"` } }), stem, ""))"""
    for stem, sent, saved in (
        ("vase", "_qs11x6a0.5625.png", "vase_qs11x6a0.5625.png"),
        ("../../<b>", ".png", re.compile(r"[^/\\<>]*\.png")),
    ):
        with page.expect_download() as download:
            page.evaluate(save, [stem, sent])
        assert re.fullmatch(saved, download.value.suggested_filename)


def test_an_export_has_a_time_and_notes_of_its_own(page):
    open_scene(page)
    status, exported = page.locator("#status"), page.locator("#exported")
    expect(status).to_contain_text("Done in")
    shown = status.text_content()
    times = page.locator("#times").text_content()
    page.locator("#format").select_option("displays/quilt")
    hold_posts(page, "displays")
    page.get_by_role("button", name="Download").click()
    check_progress(page)
    expect(exported).to_have_text("Export")
    page.get_by_role("button", name="Cancel").click()
    expect(exported).to_have_text("Cancelled.")
    expect(page.locator("#export-form").get_by_role("button", name="Try again")).to_be_focused()
    page.unroute_all()
    note = {"notes": ["it is small"], "timings_ms": {"encode": 1}}
    page.route("**/v1/displays", lambda route: route.fulfill(json={"id": "a", "state": "done", "report": note}))
    page.route("**/v1/displays/a/result", lambda route: route.fulfill(body=b"quilt"))
    with page.expect_download():
        page.get_by_role("button", name="Download").click()
    expect(exported).to_contain_text("Done in")
    expect(page.locator("#export-notes")).to_have_text("it is small")
    assert (status.text_content(), page.locator("#times").text_content()) == (shown, times)
    expect(page.locator("#notes")).to_be_empty()
    page.get_by_label("Model of the Looking Glass").select_option("go")
    for line in ("#exported", "#export-notes"):
        expect(page.locator(line)).to_be_empty()
    with page.expect_download():
        page.get_by_role("button", name="Download").click()
    expect(exported).to_contain_text("Done in")
    choose_mode(page, "As mapped")
    wait_for_picture(page, 20, 30)
    for line in ("#exported", "#export-notes"):
        expect(page.locator(line)).to_be_empty()


def test_an_export_that_ends_a_picture_leaves_no_time_of_it(page):
    hold_posts(page, "reconstructions", "views")
    open_scene(page)
    choose_mode(page, "Look around")
    expect(page.locator("#status")).to_have_text("As mapped")
    with page.expect_download():
        page.get_by_role("button", name="Download").click()
    expect(page.locator("#exported")).to_contain_text("Done in")
    expect(page.locator("#status")).to_be_empty()
