"""`ciir convert` to pictures for displays, as a display's owner types it."""

import io
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import ciir
from ciir.renderer.displays.devices import DEVICES
from ciir.renderer.displays.lenticular import interlace, parse_calibration
from ciir.renderer.displays.quilt import QuiltLayout, split_quilt
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from ciir.service.cli.main import main
from ciir.service.pipeline.displays import pictures as displays
from tests.support.displays import CALIBRATION
from tests.support.light_fields import make_views

VIEWS = make_views((3, 6), disparities=(1, 1), side=24, channels=3)
PANEL = """
[panel]
pixels = [60, 40]
pitch = 0.1
[lenses]
pitch = 1.0
gap = 3.0
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A light field of cameras, a calibration and a panel, in the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(DEVICES, "portrait", replace(DEVICES["portrait"], width=96, height=96))
    LightField(VIEWS, depth_sense="cameras").save("in.npz")
    (tmp_path / "c.json").write_text(json.dumps(CALIBRATION))
    (tmp_path / "p.toml").write_text(PANEL)
    (tmp_path / "in.json").write_text('"text"')
    return tmp_path


def read(path):
    return decode(path.read_bytes(), name=path.name)


def convert(words):
    return main(["convert", *words.split()])


def test_a_mesh_becomes_a_quilt_that_is_read_back(folder, capsys):
    assert convert("scene:vase -o vase_qs3x2a0.75.png --report r.json") == 0
    quilt = read(folder / "vase_qs3x2a0.75.png")
    assert quilt.shape == (2 * 42, 3 * 32, 3)
    assert json.loads((folder / "vase_qs3x2a0.75.png.json").read_text())["viewX"] == 3
    assert "quilt of 3x2 views, 96x84 pixels" in capsys.readouterr().out
    report = json.loads((folder / "r.json").read_text())
    assert report["display"]["layout"] == {"cols": 3, "rows": 2, "aspect": 0.75}
    assert np.array(report["scene_transform"]).shape == (4, 4)
    assert report["options"]["place"] == 0.0
    assert any(note.startswith("depth: the display is sharp up to") for note in report["notes"])
    assert convert("vase_qs3x2a0.75.png -o back.npy") == 0
    assert np.load(folder / "back.npy").shape == (1, 6, 42, 32, 3)


@pytest.mark.parametrize("to", ["-o out_qs2x1a1.png", "-o out.png --display p.toml", "-o out.png --calibration c.json"])
def test_black_before_black_is_noted(folder, capsys, to):
    (folder / "set").mkdir()
    (folder / "set/a.mtl").write_text("newmtl black\nKd 0 0 0\n")
    (folder / "set/a.obj").write_text("mtllib a.mtl\nusemtl black\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    note = "the object hardly stands out from the background 000000: 0.0 % of its pixels differ by over 16 levels"
    assert convert(f"set {to}") == 0
    assert f"{note}; give another one, such as background ffffff" in capsys.readouterr().err
    assert convert(f"set {to} --background ffffff") == 0
    assert note[:40] not in capsys.readouterr().err


@pytest.mark.parametrize("name", ["scene:vase", "in.npz"])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize(("options", "ppi"), [("--display p.toml", 254), ("--calibration c.json", 338)])
def test_pictures_of_a_known_pixel_size_state_their_resolution(folder, name, suffix, options, ppi):
    assert convert(f"{name} -o out{suffix} {options}") == 0
    picture = Image.open(io.BytesIO((folder / f"out{suffix}").read_bytes()))
    assert picture.info["dpi"] == pytest.approx((ppi, ppi), rel=5e-5)


def test_a_print_is_cast_from_its_viewers_distance(folder, capsys):
    numbers = CALIBRATION | {"subpixels": "none", "invView": 1, "viewDistance": 3}
    (folder / "print.json").write_text(json.dumps(numbers))
    screen = displays._find_screen(parse_calibration(json.dumps(numbers).encode(), name="print.json"))
    assert screen.distance == pytest.approx(3 * 338 / 80)
    assert convert("scene:vase -o near.png --calibration print.json --report r.json") == 0
    assert "seen from 3 inches, the pitch of 47.3 becomes 46.8" in capsys.readouterr().err
    shown = json.loads((folder / "r.json").read_text())["display"]
    assert 0.5 / math.tan(math.radians(shown["field_of_view"]) / 2) == pytest.approx(screen.distance)


@pytest.mark.parametrize("name", ["scene:vase", "in.npz"])
def test_a_print_by_its_size_is_the_one_of_its_json(folder, capsys, name):
    numbers = {"pitch": 20, "viewDistance": 10, "DPI": 100, "screenW": 150, "screenH": 100, "slope": 10000}
    (folder / "print.json").write_text(json.dumps(numbers | {"center": 0, "invView": 1, "subpixels": "none"}))
    assert convert(f"{name} -o json.png --calibration print.json") == 0
    wanted, given = (folder / "json.png").read_bytes(), {"print": "1.5x1in", "lpi": 20, "dpi": 100}
    assert convert(f"{name} -o in.png --print 1.5x1in --lpi 20 --dpi 100 --view-distance 10in") == 0
    assert convert(f"{name} -o mm.png --print 38.1x25.4mm --lpi 20 --dpi 100 --view-distance 254mm") == 0
    ciir.open("in.npz").save("python.png", view_distance="10in", **given)
    made = [(folder / f"{way}.png").read_bytes() for way in ("in", "mm")]
    assert made == [wanted, wanted]
    assert ((folder / "python.png").read_bytes() == wanted) == (name == "in.npz")
    notes = capsys.readouterr().err
    assert notes.count("calibration: seen from 10 inches, the pitch of 20 becomes 19.86") == 1
    assert notes.count("print: with --lpi 20 and --view-distance 10in, 19.86") == 2
    assert convert(f"{name} -o no.zip --print 1.5x1in --lpi 20 --dpi 100 --view-distance 10in") == 2
    assert "or leave --print, --lpi, --dpi, --view-distance out" in capsys.readouterr().err
    assert convert(f"{name} -o no.png --lpi 20") == 2
    assert "print: its size is missing; give width x height, such as 6x4in" in capsys.readouterr().err


def test_a_light_field_becomes_a_quilt_of_its_own_views(folder, capsys):
    assert convert("in.npz -o out.png --to quilt --quilt 3x2") == 0
    quilt = read(folder / "out_qs3x2a1.png")
    assert np.array_equal(split_quilt(quilt, QuiltLayout(3, 2, 1.0), name="q"), VIEWS[1])
    printed = capsys.readouterr().err
    assert "named out_qs3x2a1.png: displays read columns, rows and aspect from the name" in printed
    assert "views keep their aspect 1, not the device's 0.75; name the device for black borders" in printed
    assert convert("in.npz -o out.png --to quilt --device portrait") == 0
    assert "keep their aspect" not in capsys.readouterr().err


def test_without_a_device_a_quilt_stays_one_for_its_device(folder, capsys):
    row = make_views((1, 66), disparities=(0, 0), side=16, channels=3)
    LightField(row, depth_sense="cameras").save("go_qs11x6a0.5625.png")
    assert convert("go_qs11x6a0.5625.png -o same.png --to quilt --report r.json") == 0
    assert np.array_equal(read(folder / "same_qs11x6a0.5625.png"), read(folder / "go_qs11x6a0.5625.png"))
    assert "quilt: made for the device go, which shows 66 views" in capsys.readouterr().err
    assert json.loads((folder / "r.json").read_text())["display"] == {
        "kind": "quilt",
        "layout": {"cols": 11, "rows": 6, "aspect": 0.5625},
        "tile": [682, 372],
        "cone": 40.0,
        "keeps_aspect": True,
    }
    assert convert("go_qs11x6a0.5625.png -o large.png --to quilt --model bicubic --scale 2 --order given") == 0
    assert read(folder / "large_qs11x6a0.5625.png").shape[0] == 2 * read(folder / "go_qs11x6a0.5625.png").shape[0]
    LightField(row, depth_sense="cameras").save("views")
    assert convert("views -o views.png --to quilt --pixels 1x66 --order given") == 0
    assert (folder / "views_qs11x6a1.png").is_file()


@pytest.mark.parametrize("words", ["--pixels 3x2", "--lenses 24x24"])
def test_numbers_of_lenses_are_refused_for_a_quilt(folder, capsys, words):
    assert convert("in.npz -o q_qs3x2a1.png") == 0
    assert convert(f"q_qs3x2a1.png -o back.npy {words}") == 2
    option = words[2:8]
    assert f"{option}: q_qs3x2a1.png is a quilt of 3x2 views (columns x rows)" in capsys.readouterr().err
    assert convert(f"q_qs3x2a1.png -o back.npy {words} --arrangement mosaic") == 0


def test_depth_sense_gives_the_order(folder):
    LightField(VIEWS[::-1, ::-1], depth_sense="lenses").save("lenses.npz")
    for name in ("in", "lenses"):
        assert convert(f"{name}.npz -o {name}_qs3x2a1.png --order given") == 0
    assert np.array_equal(read(folder / "in_qs3x2a1.png"), read(folder / "lenses_qs3x2a1.png"))


@pytest.mark.parametrize("sense", ["cameras", "lenses"])
def test_of_a_set_of_views_only_the_middle_row_is_decoded(folder, sense):
    cameras = np.concatenate([VIEWS[:, :5], VIEWS[:1, :5]])  # four rows: the middle one is the upper of two
    LightField(cameras if sense == "cameras" else cameras[::-1, ::-1], depth_sense=sense).save("views")
    for v in (0, 3, 2 if sense == "cameras" else 1):
        (folder / "views" / f"view_{v:02d}_01.png").write_bytes(b"\x89PNG\r\n\x1a\nno picture")
    assert convert("views -o q_qs5x1a1.png --order given") == 0
    found = split_quilt(read(folder / "q_qs5x1a1.png"), QuiltLayout(5, 1, 1.0), name="q")
    assert np.array_equal(found, VIEWS[1, :5])


@pytest.mark.parametrize("words", ["-o a_qs3x2a1.png", "-o a.png --calibration c.json", "-o a.png --display p.toml"])
@pytest.mark.parametrize("scale", [2, 3])
def test_views_are_upscaled_first(folder, words, scale):
    """As if the upscaled light field had been the input, with the same unit of `disparity`."""
    ciir.upscale(ciir.open("in.npz"), model="bicubic", scale=scale).save("large.npz")
    pictures = []
    for given in (f"in.npz --model bicubic --scale {scale}", "large.npz"):
        assert convert(f"{given} {words} --disparity 0.5 --order given --report r.json") == 0
        report = json.loads((folder / "r.json").read_text())
        pictures.append(read(folder / words.split()[1]))
        assert report.get("plan", {}).get("model") == (None if given == "large.npz" else "bicubic")
        assert ("onnxruntime" in report["versions"]) == (given != "large.npz")
    assert np.array_equal(*pictures)


@pytest.mark.parametrize("sense", ["cameras", "lenses"])
def test_only_the_middle_row_is_upscaled_for_a_quilt(folder, monkeypatch, sense):
    upscaled = []
    collect = displays.collect_views

    def spy(source, options, **others):
        upscaled.append(options.views)
        return collect(source, options, **others)

    monkeypatch.setattr(displays, "collect_views", spy)
    LightField(VIEWS[[0, 1, 2, 2], :3], depth_sense=sense).save("four.npz")
    assert convert("four.npz -o q_qs3x1a1.png --model bicubic --order given") == 0
    assert upscaled == ["1,0;1,1;1,2" if sense == "cameras" else "2,0;2,1;2,2"]
    assert convert("four.npz -o p.png --display p.toml --model bicubic --order given") == 0
    assert upscaled[1:] == ["all"]


def test_the_size_of_larger_views_is_checked_before_they_are_made(folder, monkeypatch, capsys):
    LightField(np.zeros((1, 2, 60, 5000, 3), np.uint8), depth_sense="cameras").save("wide.npz")
    assert convert("wide.npz -o q_qs2x1.webp --order given") == 0
    monkeypatch.setattr(displays, "collect_views", None)
    assert convert("wide.npz -o q_qs2x1.webp --order given --model bicubic") == 2
    assert "WebP holds 8 bit and 16383 pixels along a side, not 8 bit and 20000x120" in capsys.readouterr().err


def test_the_sampling_of_views_that_are_upscaled_may_be_given(folder, capsys):
    assert convert("in.npz -o a_qs3x2a1.png --sampling lenslet") == 2
    assert "sampling: this is for meshes and upscaled views" in capsys.readouterr().err
    for words in ("-o a_qs3x2a1.png", "-o a.png --calibration c.json", "-o a.png --display p.toml"):
        assert convert(f"in.npz {words} --sampling lenslet --model fast --order given") == 0


@pytest.mark.parametrize("words", ["in.npz -o q_qs3x2a1.png", "in.npz -o larger.npy", "scene:vase -o q_qs3x2a1.png"])
def test_a_scale_without_a_model_is_refused(folder, capsys, words):
    for scale in (2, 3):
        assert convert(f"{words} --scale {scale}") == 2
        assert "scale: views are written as they are unless a model upscales them" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["out_qs3x2a1.png", "out.png"])
def test_a_report_does_not_replace_a_quilts_layout(folder, capsys, name):
    (folder / "out_qs3x2a1.png.json").write_text("{}")
    assert convert(f"in.npz -o {name} --quilt 3x2 --aspect 1 --report out_qs3x2a1.png.json") == 2
    assert "out_qs3x2a1.png.json: two outputs have this name; give each its own" in capsys.readouterr().err
    assert (folder / "out_qs3x2a1.png.json").read_text() == "{}"
    assert not (folder / "out_qs3x2a1.png").exists()


@pytest.mark.parametrize("given", ["--display p.toml", "--calibration c.json", "--print 1x1in --lpi 10 --dpi 100"])
def test_only_a_quilt_has_the_name_of_a_quilt(folder, capsys, given):
    kind = "panel" if "display" in given else "lenticular"
    for name in ("scene:vase", "in.npz"):
        assert convert(f"{name} -o a_qs4x2a1.png {given}") == 2
        message = f"the output's name says qs4x2a1, so it would be read as a quilt; give the {kind} picture another"
        assert message in capsys.readouterr().err
    assert not (folder / "a_qs4x2a1.png").exists()


def test_a_quilt_that_becomes_no_quilt_is_noted(folder, capsys):
    assert convert("in.npz -o q_qs3x2a1.png") == 0
    assert "one row of views" not in capsys.readouterr().err
    assert convert("q_qs3x2a1.png -o larger.png --model bicubic") == 0
    assert "note: eia: lenses of 6 pixels side by side, as there is one row of views" in capsys.readouterr().err
    assert convert("in.npz -o larger.png") == 0
    assert "one row of views" not in capsys.readouterr().err


def test_a_quilt_becomes_a_native_picture(folder, capsys):
    assert convert("in.npz -o q_qs8x6a1.png") == 0
    assert convert("q_qs8x6a1.png -o native.png --to lenticular --calibration c.json --disparity 0.5") == 0
    assert read(folder / "native.png").shape == (80, 120, 3)
    assert "lenticular picture, 120x80 pixels" in capsys.readouterr().out
    assert convert("q_qs8x6a1.png -o native.png --calibration c.json") == 0
    views = split_quilt(read(folder / "q_qs8x6a1.png"), QuiltLayout(8, 6, 1.0), name="q")
    padded = np.pad(views, ((0, 0), (0, 0), (6, 6), (0, 0)))
    calibration = parse_calibration((folder / "c.json").read_bytes(), name="c")
    assert np.array_equal(read(folder / "native.png"), interlace(padded, calibration))


def test_meshes_and_light_fields_become_a_panels_picture(folder, capsys):
    assert convert("scene:vase -o mesh.png --display p.toml --rotate 30,0,0 --report r.json") == 0
    assert convert("in.npz -o views.png --display p.toml --conversion none") == 0
    assert read(folder / "mesh.png").shape == read(folder / "views.png").shape == (40, 60, 3)
    printed = capsys.readouterr()
    assert "panel picture, 60x40 pixels" in printed.out
    assert "for disparities from" in printed.err
    assert json.loads((folder / "r.json").read_text())["display"]["distance"] is None


@pytest.mark.parametrize("to", ["-o q_qs4x1a0.75.png", "-o n.png --calibration c.json", "-o p.png --display near.toml"])
@pytest.mark.parametrize("place", ["-1", "0", "1"])
def test_a_mesh_fits_into_every_view(folder, capsys, to, place):
    """A cuboid, whose nearest corners a viewer at a distance sees larger than a distant one does."""
    (folder / "near.toml").write_text(f"{PANEL}[viewer]\ndistance = 20\n")
    (folder / "box.obj").write_text(make_box(1, 1, 1))
    assert convert(f"box.obj {to} --place {place} --report r.json") == 0
    assert "leaves the frame" not in capsys.readouterr().err
    framed = json.loads((folder / "r.json").read_text())["scene_transform"]
    assert convert(f"box.obj {to} --place {place} --zoom 1.5 --report r.json") == 0
    assert "of the surface leaves the frame in some directions" in capsys.readouterr().err
    zoomed = json.loads((folder / "r.json").read_text())["scene_transform"]
    assert np.array(zoomed)[:3] == pytest.approx(1.5 * np.array(framed)[:3])


@pytest.mark.parametrize("to", ["-o q_qs4x1a0.75.png", "-o n.png --calibration c.json", "-o p.png --display near.toml"])
@pytest.mark.parametrize("placed", ["", "--place -1", "--fit none --zoom 0.3"])
def test_a_depth_factor_flattens_a_mesh_at_its_size(folder, capsys, to, placed):
    """The note gives the one with which nothing blurs."""
    (folder / "near.toml").write_text(f"{PANEL}[viewer]\ndistance = 20\n")
    (folder / "box.obj").write_text(make_box(1, 1, 9))
    matrices, pictures = {}, {}
    for factor in ("", " --depth-factor 1", " --depth-factor 0.5"):
        assert convert(f"box.obj {to} {placed}{factor} --report r.json") == 0
        matrices[factor] = np.array(json.loads((folder / "r.json").read_text())["scene_transform"])
        pictures[factor] = (folder / to.split()[1]).read_bytes()
    whole, one, half = matrices.values()
    assert np.array_equal(whole, one)
    assert np.array_equal(np.diag([1, 1, 0.5, 1]) @ whole, half)
    whole, one, half = pictures.values()
    assert whole == one != half
    assert convert(f"box.obj {to} {placed} --depth-factor 50") == 0
    (sharp,) = set(re.findall(r"with --depth-factor ([0-9.]+),", capsys.readouterr().err))
    assert convert(f"box.obj {to} {placed} --depth-factor {sharp}") == 0
    assert "blurs" not in capsys.readouterr().err
    larger = float(sharp) * 1.2
    assert convert(f"box.obj {to} {placed} --depth-factor {larger}") == 0
    assert "blurs" in capsys.readouterr().err


def test_a_light_field_has_no_depth_factor(folder, capsys):
    assert convert("in.npz -o q.png --to quilt --depth-factor 0.5") == 2
    refused = (
        "--depth-factor: this is for meshes and in.npz holds pictures; leave it out, or give only the middle views"
    )
    assert refused in capsys.readouterr().err


def make_box(*sides):
    """An OBJ of a cuboid."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * sides
    lines = [f"v {x} {y} {z}" for x, y, z in corners.tolist()]
    return "\n".join([*lines, "f 1 2 4 3", "f 5 7 8 6", "f 1 5 6 2", "f 3 4 8 7", "f 1 3 7 5", "f 2 6 8 4"])


def test_a_mesh_in_another_unit_needs_no_fit_none(folder, capsys):
    (folder / "far.obj").write_text("v -9 -9 -90\nv 9 -9 -90\nv 0 9 -90\nf 1 2 3\n")
    assert convert("far.obj -o q_qs4x1a0.75.png --fit none") == 0
    printed = capsys.readouterr().err
    assert "with --fit none, the mesh's coordinates count as screen heights; leave --fit out" in printed
    assert "blurs" not in printed
    assert convert("far.obj -o q_qs4x1a0.75.png") == 0
    assert "; the scene lies in it\n" in capsys.readouterr().err


def test_with_fit_none_a_mesh_stays_at_its_own_place(folder):
    """A square 2 mm wide, 1 mm to the right of the panel's middle, in the plane of its lenses."""
    (folder / "a.obj").write_text("v 0 -1 0\nv 2 -1 0\nv 2 1 0\nv 0 1 0\nf 1 2 3 4\n")
    assert convert("a.obj -o a.png --display p.toml --fit none --report r.json") == 0
    assert json.loads((folder / "r.json").read_text())["scene_transform"] == np.eye(4).tolist()
    is_seen = read(folder / "a.png").max(axis=2) > 0
    assert not is_seen[:, :25].any()
    assert is_seen[18:22, 35:45].all()
    assert not is_seen[:, 55:].any()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("in.npz -o a.png --to lenticular", "calibration: a lenticular picture needs it; give the JSON file"),
        ("in.npz -o a.png --to panel", "display: a panel's picture needs it; give a TOML file"),
        ("in.npz -o a.png --to eia --device go", "device: format eia has no use for it; leave it out, or give format"),
        ("in.npz -o a.png --display p.toml --fps 9", "fps: format panel has no use for it"),
        ("in.npz -o a.png --to quilt --device phone", "device: 'phone' is not known; give portrait, go,"),
        ("in.npz -o a.png --to quilt --quilt 8", "quilt: '8' is not understood; give columns x rows"),
        ("in.npz -o a.png --to quilt --quilt 99x1", "quilt: 99x1 is out of range"),
        ("in.npz -o a_qs8x6a1.png --device go", "name says qs8x6a1 and the options say qs11x6a0.5625"),
        ("in.npz -o a.zip --to quilt", "a.zip: a quilt is written as .png, .tif, .tiff, .jpg, .jpeg, .webp; end"),
        ("in.npz -o a.jpg --print 1x1in --lpi 10 --dpi 100", "a.jpg: a print is written as .png, .tif, .tiff"),
        ("in.npz -o a.npy --device go", "a.npy: a quilt is written as .png, .tif, .tiff, .jpg, .jpeg, .webp; end"),
        ("in.npz -o a.npy --device go", "the name with one of them, or leave --device out"),
        ("in.npz -o a.npy --display p.toml", "the name with one of them, or leave --display out"),
        ("in.npz -o a.npy --calibration c.json", "a.npy: a lenticular is written as .png, .tif, .tiff, .webp; end"),
        ("in.npz -o a.jpg --display p.toml", "a.jpg: a panel is written as .png, .tif, .tiff, .webp; end"),
        ("in.npz -o a.png --display none.toml", "none.toml: No such file"),
        ("in.npz -o a.png --display c.json", "c.json: not TOML but JSON; give a lenticular display's calibration"),
        ("in.npz -o a.png --calibration p.toml", "p.toml: not JSON; this describes a panel under lenses; give it as"),
        ("in.npz -o a.png --display in.json", "in.json: not TOML ("),
        ("in.npz -o a.png --calibration in.json", "in.json: no calibration; give the JSON that the display stores"),
        ("in.npz -o a.png --display p.toml --conversion x", "conversion: 'x' is not known; give spoc or none"),
        ("in.npz -o a.png --display p.toml --disparity x", "disparity: 'x' is not a number"),
        ("in.npz -o a.png --display p.toml --zoom 2", "zoom: this is for meshes and in.npz holds pictures"),
        ("scene:vase -o a.png --display p.toml --lenses 9x9", "lenses: this is set by the display; leave it out"),
        *(
            (f"scene:vase -o a.png --calibration c.json --{given}", "this is for pictures and ")
            for given in (
                *("flip u", "transpose", "depth-sense lenses", "crop 1,1,1,1"),
                *("arrangement eia", "frame 3", "order given"),
            )
        ),
        ("scene:vase -o a.png --display p.toml --pickup optical", "pickup: optical is for elemental image arrays"),
        ("scene:vase -o a.png --calibration c.json --sampling lenslet", "sampling: a native picture takes one ray"),
        ("scene:vase -o a.png --display p.toml --disparity 1", "disparity: this is for light fields"),
        (
            "in.npz -o a_qs3x2a1.mp4",
            "a_qs3x2a1.mp4: _qs3x2a1 names a quilt, and mp4 holds no quilts; end the name with",
        ),
        (
            "scene:vase -o a.png --display p.toml --model auto",
            "model: this is for light fields, and scene:vase is a mesh, whose pixels are all ray-traced; leave it out",
        ),
        ("in.npz -o a_qs3x2a1.png --model none-such", "model: no 'none-such' here"),
        ("scene:vase -o a.png --display p.toml --backend raster", "backend: pictures for displays are ray-traced"),
    ],
)
def test_mistakes_are_named_in_one_line(folder, capsys, words, message):
    assert convert(words) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (folder / "a.png").exists()


def test_the_input_is_never_replaced(folder, capsys):
    assert convert("in.npz -o q_qs3x2a1.png") == 0
    assert convert("q_qs3x2a1.png -o q.png --to quilt --quilt 3x2") == 2
    assert "the input is there" in capsys.readouterr().err


def test_a_name_without_an_aspect_makes_a_quilt_and_is_kept(folder, capsys):
    for words in ("in.npz -o q_qs3x2.png", "in.npz -o q_qs3x2.png --to quilt"):
        assert convert(words) == 0
        printed = capsys.readouterr()
        assert "q_qs3x2.png: quilt of 3x2 views" in printed.out
        assert "its name has no aspect; views of a mesh get 0.75, others keep their own" in printed.err
    assert json.loads((folder / "q_qs3x2.png.json").read_text())["aspect"] == 1.0
    assert convert("q_qs3x2.png -o q_qs3x2_qs2x3a1.png") == 0
    assert "quilt of 2x3 views" in capsys.readouterr().out


@pytest.mark.parametrize("given", ["scene:vase", "in.npz"])
def test_what_webp_cannot_hold_is_refused_before_a_picture_is_made(folder, monkeypatch, capsys, given):
    for name in ("show_light_field", "_render"):
        monkeypatch.setattr(f"ciir.service.pipeline.displays.pictures.{name}", None)
    (folder / "wide.toml").write_text("[panel]\npixels=[17000,40]\npitch=0.1\n[lenses]\npitch=1.0\ngap=3.0\n")
    assert convert(f"{given} -o a.webp --display wide.toml") == 2
    assert "WebP holds 8 bit and 16383 pixels along a side, not 8 bit and 17000x40 (width x height)" in (
        capsys.readouterr().err
    )


def test_a_quilt_alone_in_a_folder_keeps_its_aspect(folder):
    """Its pixels are not square, as its name says."""
    (folder / "box").mkdir()
    quilt = VIEWS[1].reshape(2, 3, 24, 24, 3)[::-1].swapaxes(1, 2).reshape(48, 72, 3)
    (folder / "box/q_qs3x2a2.png").write_bytes(encode_png(quilt))
    for given in ("box/q_qs3x2a2.png", "box"):
        assert convert(f"{given} -o out.png --to quilt --quilt 3x2 --report r.json") == 0
        assert json.loads((folder / "r.json").read_text())["display"]["layout"]["aspect"] == 2.0
