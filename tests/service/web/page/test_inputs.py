"""Ways to give the page a file, and hostile names in all that it shows of one."""

import json
import shutil
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from playwright.sync_api import expect

from ciir.renderer.readers.pictures import decode
from ciir.renderer.readers.registry import SUFFIXES, is_mesh
from ciir.renderer.writers.pictures import encode_png
from tests.support.browser import needs_browser
from tests.support.browser.page import choose, drop, go_to, set_field, wait_for_picture
from tests.support.inputs import CUBE, EIA_PNG, make_picture

pytestmark = [needs_browser, pytest.mark.slow]
MARKUP = "<img src=x onerror=alert(1)>"
CUBE_OBJ = f"""mtllib {MARKUP}.mtl
o {MARKUP}
v -1 -1 0\nv 1 -1 0\nv 0 1 0
usemtl {MARKUP}
f 1 2 3
"""


def make_views(folder):
    """Writes 3x3 views of 8x10 pixels, out of their order."""
    folder.mkdir()
    for number in reversed(range(9)):
        picture = encode_png(make_picture(8, 10, seed=number))
        (folder / f"view_{number // 3:02d}_{number % 3:02d}.png").write_bytes(picture)
    return folder


@pytest.fixture
def no_markup(page):
    """Fails where a dialog opens, or an element of `MARKUP` comes up."""
    page.add_init_script("""window.markup = 0; new MutationObserver(() => {
        window.markup += document.querySelectorAll("[onerror], [src=x]").length;
    }).observe(document, { subtree: true, childList: true });""")
    dialogs = []
    page.on("dialog", lambda dialog: (dialogs.append(dialog.message), dialog.dismiss()))
    page.reload()
    yield page
    assert page.evaluate("markup") == 0
    assert dialogs == []


@pytest.mark.parametrize("way", ["choose", "drop"])
def test_a_folder_is_one_set_of_views(page, tmp_path, way):
    folder = make_views(tmp_path / "views")
    page.locator("#folder").set_input_files(folder) if way == "choose" else drop(page, folder)
    wait_for_picture(page, 16, 20)
    expect(page.locator("#name")).to_have_text("views")
    expect(page.locator("#kind")).to_have_text("A set of views")
    expect(page.locator("[name=lenses]")).to_be_hidden()
    expect(page.get_by_label("Views, rows x columns")).to_have_attribute("placeholder", "3x3")
    for heading, is_shown in (("Views", True), ("Lens array", False)):
        expect(page.locator("#settings legend").get_by_text(heading, exact=True)).to_be_visible(visible=is_shown)


def test_views_are_read_in_the_order_that_a_note_names(page, tmp_path):
    drop(page, make_views(tmp_path / "views"))
    wait_for_picture(page, 16, 20)
    note = page.locator("#notes")
    expect(note).to_contain_text('"First number is the column" under "Order of the views" takes them the other way')
    page.get_by_label("Order of the views").select_option(label="First number is the column")
    expect(note).to_contain_text('"First number is the row" under "Order of the views" takes them the other way')
    assert "order=columns" in page.url
    page.locator("[name=depth_sense]").select_option(label="Numbered as lens pixels")
    page.wait_for_url("**depth_sense=lenses**")  # until then, the picture would take the place of a download
    with page.expect_download() as download:
        page.locator("#format").select_option("all/npz")
        page.get_by_role("button", name="Download").click()
    with np.load(download.value.path()) as arrays:
        options = json.loads(str(arrays["report"]))["options"]
    assert (options["order"], options["depth_sense"]) == ("columns", "lenses")


def test_views_without_rows_and_columns_ask_for_them(page):
    page.expected = ["422"]
    choose(page, *((f"{number}.png", encode_png(make_picture(8, 10))) for number in range(6)))
    expect(page.get_by_role("alert")).to_contain_text('not a square number; give "Views, rows x columns"')
    set_field(page, "pixels", "2x3")
    wait_for_picture(page, 16, 20)
    page.locator("#format").select_option("all/eia")
    with page.expect_download() as download:
        page.get_by_role("button", name="Download").click()
    assert decode(download.value.path().read_bytes(), name="a.png").shape[:2] == (2 * 16, 3 * 20)


def test_several_files_are_one_set_of_views(page, tmp_path):
    files = list(make_views(tmp_path / "views").iterdir())
    drop(page, *files)
    wait_for_picture(page, 16, 20)
    expect(page.locator("#name")).to_have_text("9 files")
    dropped = page.locator("#frame img").screenshot()
    page.get_by_role("button", name="Another file").click()
    choose(page, *((path.name, path.read_bytes()) for path in files))
    wait_for_picture(page, 16, 20)
    assert page.locator("#frame img").screenshot() == dropped


def test_a_file_is_dropped(page, tmp_path):
    (tmp_path / "cube.off").write_bytes(CUBE)
    go_to(page, "#file=cube.off&lenses=20x20&pixels=3x3")
    drop(page, tmp_path / "cube.off")
    expect(page.locator("#kind")).to_have_text("A mesh")
    wait_for_picture(page, 40, 40)


@pytest.mark.parametrize("way", ["open", "reload"])
def test_another_file_has_settings_of_its_own(page, way):
    go_to(page, "#file=cube.off&lenses=20x20&pixels=3x3&rotate=0,90,0&show=mapped&v=1&u=2&focus=1.5")
    choose(page, ("cube.off", CUBE))
    wait_for_picture(page, 20, 20)
    if way == "reload":
        page.reload()
        expect(page.locator("#again")).to_have_text("Choose cube.off again; its settings are kept.")
    choose(page, ("eia.png", EIA_PNG))
    expect(page.locator("#status")).to_contain_text("How many lenses")
    assert page.url.endswith("/#file=eia.png&model=auto&scale=2&show=upscaled")


def test_a_file_that_cannot_be_read_takes_the_settings_of_no_other(page):
    page.expected = ["415"]
    go_to(page, "#file=cube.off&lenses=20x20&pixels=3x3")
    choose(page, ("cube.off", CUBE))
    wait_for_picture(page, 40, 40)
    choose(page, ("bad.obj", b"hello\n"))
    expect(page.get_by_role("alert")).to_contain_text("bad.obj")
    assert page.url.endswith("/#file=bad.obj")
    page.go_back()
    expect(page.locator("#again")).to_have_text("Choose cube.off again; its settings are kept.")
    assert "lenses=20x20" in page.url


def test_names_of_views_never_become_markup(no_markup, tmp_path):
    page = no_markup
    drop(page, make_views(tmp_path / MARKUP))
    wait_for_picture(page, 16, 20)
    expect(page.locator("#name")).to_have_text(MARKUP)
    assert page.title() == MARKUP
    expect(page.get_by_role("button", name=f"{MARKUP}: upscaled")).to_be_visible()
    page.reload()
    expect(page.locator("#again")).to_contain_text(MARKUP)


def test_names_in_a_mesh_never_become_markup(no_markup):
    page = no_markup
    go_to(page, f"#lenses=20x20&pixels=3x3&file={quote(MARKUP)}.obj")
    choose(page, (f"{MARKUP}.obj", CUBE_OBJ.encode()))
    wait_for_picture(page, 40, 40)
    expect(page.locator("#notes")).to_contain_text(f"{MARKUP}.mtl")


def test_a_mesh_gives_its_files_their_name(page):
    go_to(page, "#file=cube.obj&lenses=20x20&pixels=3x3")
    mesh = CUBE_OBJ.replace(f"{MARKUP}.mtl", "a.mtl")
    choose(page, ("a.mtl", f"newmtl {MARKUP}\n".encode()), ("cube.obj", mesh.encode()))
    wait_for_picture(page, 40, 40)
    expect(page.locator("#name")).to_have_text("cube.obj")


@pytest.mark.parametrize(
    ("files", "name", "stem"),
    [
        (["duck.v2.glb"], "duck.v2.glb", "duck.v2"),
        (["truck.v2/scene.gltf", "truck.v2/scene.bin"], "truck.v2", "truck.v2"),
        (["scene.gltf", "scene.bin", "license.txt", "Textures/a.png"], "scene.gltf", "scene"),
        (["source/Cube.OBJ", "source/cube.mtl", "textures/a.png"], "Cube.OBJ", "Cube"),
        (["a.png", "more/b.png"], "2 files", "2 files"),
        (["a.obj", "b.obj", "more/c.png"], "3 files", "3 files"),
    ],
)
def test_files_are_named_after_the_folder_of_all_or_the_mesh(page, files, name, stem):
    script = """(names) => import("/assets/input/inputs.js").then(async ({ joinFiles, nameInput, nameStem }) => {
        const input = await joinFiles(names.map((name) => ({ name, file: new File([], name.split("/").at(-1)) })));
        return [nameInput(input), nameStem(input)];
    })"""
    assert page.evaluate(script, files) == [name, stem]


def test_the_page_knows_the_suffixes_of_meshes(page):
    script = (
        """(names) => import("/assets/input/inputs.js").then(({ MESH }) => names.filter((name) => MESH.test(name)))"""
    )
    assert set(page.evaluate(script, [f"a{suffix}" for suffix in SUFFIXES])) == {
        f"a{suffix}" for suffix in SUFFIXES if is_mesh(f"a{suffix}")
    }


def test_a_folder_of_a_version_keeps_its_name_in_downloads_and_in_those_of_recent_jobs(page, tmp_path):
    go_to(page, "#file=cube.v2&lenses=20x20&pixels=3x3&model=none")
    page.reload()
    (tmp_path / "cube.v2").mkdir()
    for name in ("cube.off", "license.txt"):
        (tmp_path / "cube.v2" / name).write_bytes(CUBE)
    drop(page, tmp_path / "cube.v2")
    wait_for_picture(page, 20, 20)
    for button in (page.get_by_role("button", name="Download"), page.get_by_role("button", name="cube.v2: export")):
        with page.expect_download() as download:
            button.click()
        assert download.value.suggested_filename == "cube.v2_view.png"


@pytest.mark.parametrize("name", ["a.rar", "a.7z", "a.tar.gz"])
def test_an_archive_that_is_not_read_has_to_be_unpacked(page, name):
    page.expected = ["415"]
    choose(page, (name, b"Rar!\x1a\x07\x01\x00"))
    suffix = Path(name).suffix
    expected = f"{name}: files of type {suffix} are not read; unpack it, and drop what is in it"
    expect(page.locator("#problem-detail")).to_have_text(expected)


def test_a_texture_that_is_missing_can_be_dropped_together_with_the_mesh(page):
    go_to(page, "#file=cube.obj&lenses=20x20&pixels=3x3&model=none")
    page.reload()
    choose(page, ("cube.obj", CUBE_OBJ.replace(f"{MARKUP}.mtl", "a.mtl").encode()))
    wait_for_picture(page, 20, 20)
    help_ = "a.mtl is missing and is left out; drop it together with the mesh, or a zip that holds both"
    for place in ("#notes p", "#remarks li"):
        assert help_ in " ".join(page.locator(place).all_text_contents())


@pytest.mark.parametrize("way", ["folder", "zip"])
def test_a_mesh_comes_with_its_files(page, tmp_path, way):
    folder = tmp_path / "cube"
    folder.mkdir()
    (folder / "cube.obj").write_text(CUBE_OBJ.replace(f"{MARKUP}.mtl", "a.mtl"))
    (folder / "a.mtl").write_text(f"newmtl {MARKUP}\nmap_Kd a.png\n")
    (folder / "a.png").write_bytes(encode_png(make_picture(8, 8)))
    go_to(page, f"#file=cube{'.zip' * (way == 'zip')}&lenses=20x20&pixels=3x3")
    expect(page.locator(".drop")).to_contain_text("An OBJ with its MTL and textures, a folder or a zip works too")
    drop(page, folder if way == "folder" else Path(shutil.make_archive(str(folder), "zip", folder)))
    wait_for_picture(page, 40, 40)
    expect(page.locator("#kind")).to_have_text("A mesh")
    expect(page.locator("#notes")).not_to_contain_text("missing")


def test_what_no_field_shows_is_left_to_the_server(page):
    page.expected = ["422"]
    go_to(page, "#file=cube.off&lenses=20x20&pixels=3x3&time=0.5")
    choose(page, ("cube.off", CUBE))
    expect(page.get_by_role("alert")).to_contain_text("time")
    expect(page.locator("#settings [name=time]")).to_be_hidden()


def test_limits_are_shown_in_megabytes_and_sizes_of_files_as_they_are(page):
    adapt = "(texts) => import('/assets/server_texts.js').then(({ adaptRemedy }) => texts.map(adaptRemedy))"
    texts = {
        "the request's body is over the limit of 67,108,864 bytes; send a smaller file": "limit of 67.1 MB; send",
        "a.zip: unpacks to 1,234,567,890 bytes; at most 268,435,456 are read": "to 1,234.6 MB; at most 268.4 MB are",
        "a.stl: 5,000,001 triangles; at most 5,000,000 are read": "5,000,001 triangles; at most 5,000,000 are read",
        "a.glb: cut short: it has 1,050,000 of 1,120,484 bytes": "it has 1,050,000 of 1,120,484 bytes",
        "'x': no such field; the fields are order, transpose, place": "the fields are order, transpose, place",
    }
    assert [part in text for part, text in zip(texts.values(), page.evaluate(adapt, list(texts)), strict=True)] == [
        True
    ] * len(texts)


def test_names_in_the_address_never_become_markup(no_markup):
    page = no_markup
    page.expected = ["422"]
    go_to(page, f"#scene={MARKUP}&model={MARKUP}&lenses={MARKUP}")
    expect(page.get_by_role("alert")).to_contain_text(MARKUP)
    expect(page.locator("#name")).to_have_text(MARKUP)


def test_a_report_never_becomes_markup(no_markup):
    page = no_markup
    report = {
        "timings_ms": {MARKUP: 1, "total": MARKUP, "decode": MARKUP},
        "plan": {"reasons": [MARKUP]},
        "notes": [MARKUP, {"a": MARKUP}],
    }
    page.route("**/v1/models", lambda route: route.fulfill(json=[{"name": MARKUP, "scales": [2, MARKUP]}]))
    page.route(
        "**/v1/reconstructions", lambda route: route.fulfill(json={"id": "a", "state": "done", "report": report})
    )
    picture = encode_png(make_picture(8, 10))
    page.route("**/v1/reconstructions/a/result", lambda route: route.fulfill(body=picture))
    go_to(page, "#scene=vase")
    page.reload()
    wait_for_picture(page, 8, 10)
    page.get_by_text("Where the time went").click()
    expect(page.locator("#remarks li").last).to_have_text(MARKUP)
    expect(page.locator("#notes p").first).to_have_text(MARKUP)
    expect(page.locator("[name=model] option").last).to_have_text(MARKUP)
