"""Meshes that turn under the mouse, with a real server: what three.js draws is what the server renders."""

import re
from base64 import b64decode
from urllib.parse import parse_qsl, urlsplit

import numpy as np
import pytest
import trimesh
from playwright.sync_api import Error, expect

from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from tests.support.browser import needs_browser
from tests.support.browser.page import (
    SMALL,
    choose,
    choose_mode,
    drop,
    go_to,
    open_scene,
    set_field,
    wait_for_picture,
    wait_for_rest,
)
from tests.support.inputs import CUBE
from tests.support.meshes.gltf import PIXELS, SQUARE, UV, Model

pytestmark = [needs_browser, pytest.mark.slow]
SIZE = 200  # lenses along a side
SERVER = """() => {
    const image = document.querySelector('#frame img'), canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
    canvas.getContext('2d').drawImage(image, 0, 0);
    return canvas.toDataURL();
}"""
PREVIEW = """() => new Promise((resolve) => {
    document.querySelector('[name=yaw]').dispatchEvent(new Event('input', { bubbles: true }));
    requestAnimationFrame(() => resolve(document.querySelector('#turn canvas').toDataURL()));
})"""


def make_mesh(suffix):
    """A mesh without symmetry, as a file."""
    shapes = [trimesh.creation.box((1, 3, 1)), trimesh.creation.box((0.8, 1, 2)), trimesh.creation.box((2, 0.4, 0.7))]
    for shape, shift in zip(shapes, ((0, 0, 0), (1.2, 0.5, 0.8), (-1, -1.3, 0.4)), strict=True):
        shape.apply_translation(shift)
    data = trimesh.util.concatenate(shapes).export(file_type=suffix)
    return data.encode() if isinstance(data, str) else data


def open_mesh(page, suffix, settings):
    """Opens the mesh with the settings of an address, and waits for the server's picture."""
    go_to(page, f"#file=a.{suffix}&lenses={SIZE}x{SIZE}&show=mapped&{settings}")
    page.reload()
    choose(page, (f"a.{suffix}", make_mesh(suffix)))
    wait_for_picture(page, SIZE, SIZE)
    page.locator("#turn canvas").wait_for(state="attached")


def read_picture(page, script):
    """The picture that a script gives, `(H, W, 3)`."""
    return decode(b64decode(page.evaluate(script).split(",")[1]), name="picture")[..., :3]


def read_silhouette(page, script):
    """Where the picture that a script gives shows the mesh, `(SIZE, SIZE)`."""
    picture = read_picture(page, script).max(-1) > 40
    rows, cols = ((np.arange(SIZE) + 0.5) * side // SIZE for side in picture.shape)
    return picture[rows.astype(int)[:, None], cols.astype(int)]


@pytest.mark.parametrize(
    ("suffix", "settings"),
    [
        ("glb", "rotate=40,25,-15"),
        ("obj", "rotate=-120,-60,100&zoom=0.7"),
        ("stl", "rotate=25,10,0&up=z&pixels=4x6"),
        ("ply", "rotate=30,0,20&place=0.5&zoom=1.5"),
        ("ply", "rotate=40,20,0&place=-1&depth_factor=0.2&pixels=2x2"),
    ],
)
def test_the_preview_shows_what_the_server_renders(page, suffix, settings):
    open_mesh(page, suffix, settings)
    server, preview = read_silhouette(page, SERVER), read_silhouette(page, PREVIEW)
    assert 0.05 < server.mean() < 0.9
    # Of 200 pixels along a side, outlines differ by half of one: nothing but the samples' places.
    assert (server & preview).sum() / (server | preview).sum() > 0.97


def make_lamp():
    """A square whose material is black, but for the light that it emits."""
    model = Model(COLOR_0=np.zeros((4, 3), np.float32), TEXCOORD_0=UV)
    model.texture(np.kron(PIXELS, np.ones((64, 64, 1), np.uint8)))
    base = model.material["pbrMetallicRoughness"]
    model.material |= {"emissiveFactor": [1, 0.5, 0], "emissiveTexture": base["baseColorTexture"]}
    base["baseColorFactor"] = [0, 0, 0, 1]
    return {"a.glb": model.glb()}


def make_namesakes():
    """A square with two textures of the same name, side by side in a folder that holds another of that name."""
    model, files = Model(TEXCOORD_0=UV), {}
    model.json |= {
        "images": [],
        "textures": [],
        "materials": [],
        "meshes": [],
        "nodes": [],
        "scenes": [{"nodes": [0, 1]}],
    }
    for number, colour in enumerate(((255, 0, 0), (0, 255, 0), (0, 0, 255))):
        files[f"{'abc'[number]}/color.png"] = encode_png(np.full((4, 4, 3), colour, np.uint8))
        texture = {"baseColorTexture": {"index": number}}
        model.json["images"].append({"uri": f"../{'abc'[number]}/color.png"})
        model.json["textures"].append({"source": number})
        model.json["materials"].append({"extensions": {"KHR_materials_unlit": {}}, "pbrMetallicRoughness": texture})
        model.json["meshes"].append({"primitives": [model.primitive | {"material": number}]})
        model.json["nodes"].append({"mesh": number, "translation": [number, 0, 0]})
    model.json["extensionsUsed"] = ["KHR_materials_unlit"]
    return files | {"scenes/a.gltf": model.gltf("a%20b.bin"), "scenes/a b.bin": model.binary}


def make_needle():
    """A square, and a triangle without area that reaches far out of it."""
    model = Model(POSITION=np.concatenate([SQUARE, [[30, 20, 10]]]).astype(np.float32))
    model.primitive["indices"] = model.add(np.array([0, 1, 2, 0, 2, 3, 4, 4, 4], np.uint16))
    return {"a.glb": model.glb()}


def make_leaves():
    """Two squares beside each other, the second of which shows its back."""
    corners = b"".join(b"v %d %d 0\n" % (x, y) for x in range(3) for y in range(2))
    return {"a.obj": corners + b"f 1 3 4 2\nf 4 6 5 3\n"}


@pytest.mark.parametrize("make", [make_lamp, make_namesakes, make_needle, make_leaves])
def test_the_preview_shows_materials_as_the_server_does(page, tmp_path, make):
    go_to(page, f"#file={tmp_path.name}&lenses={SIZE}x{SIZE}&show=mapped&rotate=10,0,0")
    page.reload()
    for name, data in (make() | {"license.txt": b""}).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(data)
    drop(page, tmp_path)
    wait_for_picture(page, SIZE, SIZE)
    page.locator("#turn canvas").wait_for(state="attached")
    server, preview = (read_picture(page, script).astype(int) for script in (SERVER, PREVIEW))
    rows = (np.arange(SIZE) + 0.5) * len(preview) // SIZE
    preview = preview[rows.astype(int)[:, None], rows.astype(int)]
    assert server.max() > 100
    assert (np.abs(server - preview).max(-1) > 40).mean() < 0.05


def add_texture_transform(model, **transform):
    model.texture().material["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = {
        "KHR_texture_transform": transform
    }


@pytest.mark.parametrize(
    ("extension", "change", "is_shown"),
    [
        ("KHR_texture_transform", lambda model: add_texture_transform(model, rotation=1, scale=[1, 2]), False),
        ("KHR_texture_transform", lambda model: add_texture_transform(model, rotation=1, scale=[2, 2]), True),
        ("KHR_texture_transform", lambda model: add_texture_transform(model, scale=[1, 2]), True),
        ("KHR_node_visibility", lambda _: None, False),
        ("KHR_materials_transmission", lambda _: None, False),
        ("KHR_materials_pbrSpecularGlossiness", lambda _: None, False),
        ("EXT_texture_avif", lambda _: None, False),
        ("KHR_materials_ior", lambda _: None, True),
    ],
)
def test_there_is_no_preview_of_what_the_server_shows_otherwise(page, extension, change, is_shown):
    model = Model(TEXCOORD_0=UV)
    model.json["extensionsUsed"] = [extension]
    change(model)
    script = """async (data) => {
        const { Preview } = await import("/assets/mesh/preview.js");
        const preview = new Preview(document.createElement("canvas"));
        const file = new File([Uint8Array.from(data)], "a.glb");
        return preview.open([{ name: "a.glb", file }]).then(() => true, () => false).finally(() => preview.close());
    }"""
    assert page.evaluate(script, list(model.glb())) == is_shown


def test_a_background_is_chosen_and_shown_by_the_preview_too(page):
    def read_corners():
        return {tuple(read_picture(page, script)[0, 0]) for script in (SERVER, PREVIEW)}

    open_mesh(page, "glb", "rotate=10,0,0&background=FFD0a0")
    field = page.get_by_label("Background")
    expect(field).to_have_value("#ffd0a0")
    assert read_corners() == {(255, 208, 160)}
    field.fill("#204060")
    page.wait_for_url("**background=204060**")
    expect(page.locator("#status")).to_contain_text("Done in")
    assert read_corners() == {(32, 64, 96)}
    field.fill("#000000")  # as usual
    page.wait_for_url(lambda url: "background" not in url)


@pytest.mark.parametrize(
    ("text", "colour"), [("teal", "#008080"), ("white", "#ffffff"), ("%23fff", "#ffffff"), ("FFF", "#ffffff")]
)
def test_a_background_as_the_server_takes_it_is_shown_and_changed(page, text, colour):
    open_mesh(page, "glb", f"background={text}")
    field = page.locator("#settings [name=background]")
    expect(field).to_have_value(colour)
    field.fill("#000000")
    page.wait_for_url(lambda url: "background" not in url)


def test_a_background_that_is_none_is_refused(page):
    page.expected = ["422"]
    go_to(page, "#scene=vase&lenses=20x30&pixels=3x3&background=crimson")
    expect(page.get_by_role("alert")).to_contain_text("background: 'crimson'")


def test_a_mesh_turns_under_the_mouse_before_it_is_rendered(page):
    open_mesh(page, "glb", "rotate=10,0,0")
    canvas, before = page.locator("#turn canvas"), read_silhouette(page, SERVER)
    expect(canvas).to_be_hidden()
    box = page.locator("#turn").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + box["width"] / 6, y + box["width"] / 9)
    expect(canvas).to_be_visible()
    expect(page.locator("[name=yaw]")).to_have_value("40")
    expect(page.locator("[name=tilt]")).to_have_value("20")
    page.mouse.up()
    expect(canvas).to_be_hidden()
    assert "rotate=40%2C20%2C0" in page.url
    assert (read_silhouette(page, SERVER) != before).any()


def test_a_preview_that_is_late_does_not_cover_what_the_server_rendered(page):
    page.add_init_script("""
        const next = requestAnimationFrame.bind(window);
        window.requestAnimationFrame = (action) => setTimeout(next, 2000, action);
    """)
    held = []

    def hold(route):
        held.append(route)

    page.route("**/v1/reconstructions", hold)
    go_to(page, f"#file=a.glb&lenses={SIZE}x{SIZE}&show=mapped")
    page.reload()
    with page.expect_request("**/v1/reconstructions"):
        choose(page, ("a.glb", make_mesh("glb")))
    canvas = page.locator("#turn canvas")
    canvas.wait_for(state="attached")  # it is drawn in two seconds
    held[0].continue_()
    wait_for_picture(page, SIZE, SIZE)
    page.wait_for_timeout(2500)
    expect(canvas).to_be_hidden()


def test_previews_are_no_recent_jobs(page):
    listed = page.locator("#recent-list button span")
    open_mesh(page, "glb", "rotate=10,0,0")  # as mapped
    expect(page.locator("#status")).to_contain_text("Done in")
    expect(listed).to_have_count(0)
    page.get_by_role("radio", name="Upscaled").check()
    wait_for_picture(page, 2 * SIZE, 2 * SIZE)
    expect(listed).to_have_text([re.compile("upscaled.*turned by 10°")])
    box = page.locator("#turn").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.locator("#frame img").evaluate("each => each.classList.add('before')")
    page.mouse.move(x + box["width"] / 6, y)
    page.wait_for_url("**rotate=40**")
    page.locator("#frame img:not(.before)").wait_for()
    wait_for_picture(page, 2 * SIZE, 2 * SIZE)
    expect(page.locator("#status")).to_contain_text("Done in")
    expect(listed).to_have_count(1)
    page.mouse.up()
    expect(listed).to_have_text([re.compile("upscaled.*turned by 40°"), re.compile("upscaled.*turned by 10°")])


def test_a_mesh_turns_by_keys(page):
    open_mesh(page, "stl", "rotate=175,0,0")
    turn = page.get_by_role("application", name="Object")
    for key in ("ArrowRight", "ArrowRight", "ArrowDown", "+"):
        turn.press(key)
    expect(page.locator("#turn canvas")).to_be_visible()
    page.wait_for_url(lambda url: "rotate=-175%2C5%2C0" in url and "zoom=1.1" in url)
    expect(page.locator("#turn canvas")).to_be_hidden()


def test_a_display_gets_the_place_that_was_given_also_if_it_is_as_usual(page):
    def read_posted(address, *keys):
        page.reload()
        go_to(page, address)
        wait_for_picture(page, 40, 60)
        for key in keys:
            page.locator("#settings [name=place]").press(key)
        page.locator("#format").select_option("displays/quilt")
        with page.expect_request("**/v1/displays") as posted:
            page.get_by_role("button", name="Download").click()
        return re.findall(r'name="place"\r\n\r\n([^\r]*)\r', posted.value.post_data)

    page.route("**/v1/displays", lambda route: route.fulfill(json={"id": "a", "state": "cancelled"}))
    assert read_posted(SMALL) == []
    assert read_posted(f"{SMALL}&place=-1") == ["-1"]
    assert read_posted(f"{SMALL}&place=0.5") == ["0.5"]
    assert read_posted(SMALL, "ArrowRight", "ArrowLeft") == ["-1"]


def test_the_help_says_what_a_drag_does(page):
    shown = page.locator("#turn-help")
    open_scene(page)
    expect(shown).to_contain_text("Drag the picture to turn the object")
    for mode, text in (
        ("Look around", "moves the viewpoint"),
        ("Compare", "moves the pictures"),
        ("As mapped", "Drag the"),
    ):
        choose_mode(page, mode)
        expect(shown).to_contain_text(text)


def test_the_note_on_an_stl_names_the_setting(page):
    go_to(page, "#file=a.stl&lenses=20x20&show=mapped")
    page.reload()
    choose(page, ("a.stl", make_mesh("stl")))
    expect(page.locator("#notes")).to_contain_text('choose "z, as in CAD" under "Axis that points up"')
    page.get_by_label("Axis that points up").select_option("z")
    page.wait_for_url("**up=z**")
    expect(page.locator("#notes")).not_to_contain_text("STL")


@pytest.mark.parametrize("what", ["scene", "file"])
def test_the_server_shows_what_the_browser_cannot_read(page, what):
    if what == "scene":
        open_scene(page, "20x20")
    else:
        page.goto(f"{page.url}#file=cube.off&lenses=20x20")
        page.reload()
        choose(page, ("cube.off", CUBE))
    wait_for_picture(page, 40, 40)
    expect(page.locator("#status")).to_contain_text("Done in")
    page.locator("#frame img").evaluate("each => each.classList.add('before')")
    page.locator("#turn").press("ArrowRight")
    page.wait_for_url("**rotate=5%2C0%2C0**")
    page.locator("#frame img:not(.before)").wait_for()
    wait_for_picture(page, 40, 40)
    assert page.locator("#turn canvas").count() == 0


def test_a_mesh_asks_no_other_host(page):
    page.expected = ["data:,"]
    mesh = """{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "buffers": [{"uri": "https://evil.example/a.bin", "byteLength": 36}]}"""
    script = """async (mesh) => {
        const { Preview } = await import("/assets/mesh/preview.js");
        const file = new File([mesh], "a.gltf");
        await new Preview(document.createElement("canvas")).open([{ name: "a.gltf", file }]);
    }"""
    with pytest.raises(Error):
        page.evaluate(script, mesh)


def test_another_lens_array_is_seen_from_its_centre_and_a_turned_mesh_is_focused_again(page):
    def read_place(change):
        page.locator("#status").evaluate("each => each.textContent = ''")
        change()
        expect(page.locator("#status")).to_contain_text("Done in")
        wait_for_rest(page)
        shown = dict(parse_qsl(urlsplit(page.evaluate("location.href")).fragment))
        return {name: shown[name] for name in given}

    address = "#scene=vase&lenses=20x30&pixels=3x3&show=around&v=0.5&u=2&focus=3&aperture=1"
    given = {"v": "0.5", "u": "2", "focus": "3", "aperture": "1"}
    assert read_place(lambda: go_to(page, address)) == given
    assert read_place(lambda: page.locator("[name=model]").select_option("bicubic")) == given
    turned = read_place(lambda: page.locator("[name=yaw]").press("ArrowRight"))
    assert turned == given | {"focus": turned["focus"]}
    assert abs(float(turned["focus"])) < 2.5  # as measured
    other = read_place(lambda: set_field(page, "pixels", "5x5"))
    assert (other["v"], other["u"], other["aperture"]) == ("2", "2", "0")
