import io
import json

import numpy as np
import pytest
from PIL import Image

import ciir
from ciir.errors import InvalidOption, TooLarge, Unreadable
from ciir.renderer.displays.integral import parse_display
from ciir.renderer.displays.lenticular import interlace
from ciir.renderer.displays.panel import resample_panel
from ciir.renderer.displays.quilt import QuiltLayout, split_quilt
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.containers import displays
from ciir.renderer.writers.formats import WHOLE_BY_SUFFIX
from tests.support.displays import CALIBRATION, make_calibration
from tests.support.light_fields import make_views

FIELD = LightField(make_views((3, 48), disparities=(0, 0), side=8, channels=3), depth_sense="cameras")
WIDE = LightField(make_views((1, 48), disparities=(0, 1), side=24, channels=3)[..., :16, :, :], depth_sense="cameras")
PANEL = "[panel]\npixels = [60, 40]\npitch = 0.1\n[lenses]\npitch = 1.0\ngap = 3.0\n"


def read(path):
    return decode(path.read_bytes(), name="a")


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_the_middle_row_becomes_a_quilt(tmp_path, suffix):
    notes = FIELD.save(tmp_path / f"a{suffix}", "quilt")
    quilt = read(tmp_path / f"a{suffix}")
    assert np.array_equal(split_quilt(quilt, QuiltLayout(8, 6, 1.0), name="a"), FIELD.views[1])
    assert notes[0].startswith("quilt: made for the device portrait, which shows 48 views, as many as a row of")
    assert notes[1:] == (
        "views keep their aspect 1, not the device's 0.75; name the device for black borders that fill it",
        f"quilt: name it a_qs8x6a1{suffix}; displays read columns, rows and aspect there",
    )


@pytest.mark.parametrize("sense", ["cameras", "lenses"])
def test_a_quilt_begins_with_the_leftmost_camera(tmp_path, sense):
    views = np.random.default_rng(0).integers(0, 256, (3, 48, 8, 6, 3), np.uint8)
    LightField(views, depth_sense="cameras").with_depth_sense(sense).save(tmp_path / "a.png", "quilt")
    quilt = read(tmp_path / "a.png")
    np.testing.assert_array_equal(split_quilt(quilt, QuiltLayout(8, 6, 0.75), name="a"), views[1])
    np.testing.assert_array_equal(quilt[-8:, :6], views[1, 0])


def test_a_quilt_is_saved_as_it_was_read(tmp_path):
    """Its views are shown with the aspect in its name, whatever that of their pixels."""
    FIELD.save(tmp_path / "a_qs8x6a1.77778.png", quilt="8x6", aspect=1.77778)
    quilt = Image.fromarray(read(tmp_path / "a_qs8x6a1.77778.png")).resize((80, 90))
    quilt.save(tmp_path / "b_qs8x6a1.77778.png")
    light_field = ciir.open(tmp_path / "b_qs8x6a1.77778.png")
    notes = light_field.save(tmp_path / "c.png", quilt="8x6")
    assert np.array_equal(read(tmp_path / "c.png"), np.asarray(quilt))
    assert "name it c_qs8x6a1.77778.png" in notes[-1]
    assert json.loads((tmp_path / "c.png.json").read_text())["aspect"] == 1.77778


@pytest.mark.parametrize("name", ["a_qs11x6a0.5625.png", "a_qs5x9a1.6.png", "a_qs8x9a1.77778.png"])
def test_a_devices_quilt_keeps_its_columns_and_rows(tmp_path, name):
    count = int(name[4:].split("x")[0]) * int(name.split("x")[1].split("a")[0])
    views = make_views((1, count), disparities=(0, 0), side=16, channels=3)
    LightField(views, depth_sense="cameras").save(tmp_path / name)
    notes = ciir.open(tmp_path / name).save(tmp_path / "b.png", "quilt")
    assert np.array_equal(read(tmp_path / "b.png"), read(tmp_path / name))
    assert f"name it {name.replace('a_', 'b_')}" in notes[-1]


def test_for_a_device_views_get_its_aspect(tmp_path):
    notes = FIELD.save(tmp_path / "a.png", "quilt", device="65")
    assert read(tmp_path / "a.png").shape == (9 * 8, 8 * 14, 3)
    assert notes[0] == "72 views are interpolated from the 48 of the middle row"


def test_columns_rows_and_aspect_are_options(tmp_path):
    notes = FIELD.save(tmp_path / "a.png", "quilt", quilt="12x4", aspect=1.5)
    assert read(tmp_path / "a.png").shape == (4 * 8, 12 * 12, 3)
    assert "name it a_qs12x4a1.5.png;" in notes[-1]


def test_the_name_of_a_quilt_may_hold_its_layout(tmp_path):
    assert FIELD.save(tmp_path / "a_qs12x4a1.png", "quilt") == ()
    quilt = read(tmp_path / "a_qs12x4a1.png")
    assert np.array_equal(split_quilt(quilt, QuiltLayout(12, 4, 1.0), name="a"), FIELD.views[1])
    with pytest.raises(InvalidOption, match="name says qs12x4a1 and the options say qs11x6a"):
        FIELD.save(tmp_path / "a_qs12x4a1.png", "quilt", device="go")


def test_a_quilts_name_or_a_displays_options_name_the_format(tmp_path):
    FIELD.save(tmp_path / "a_qs12x4a1.png")
    FIELD.save(tmp_path / "b_qs12x4a1.png", "quilt")
    assert np.array_equal(read(tmp_path / "a_qs12x4a1.png"), read(tmp_path / "b_qs12x4a1.png"))
    (tmp_path / "p.toml").write_text(PANEL)
    FIELD.save(tmp_path / "p.png", display=tmp_path / "p.toml")
    assert read(tmp_path / "p.png").shape == (40, 60, 3)


@pytest.mark.parametrize("suffix", [".png", ".webp"])
def test_a_quilt_is_read_back_by_the_layout_beside_it(tmp_path, suffix):
    FIELD.save(tmp_path / f"a{suffix}", "quilt", quilt="16x3")
    found = inputs.read(Bundle.from_path(tmp_path / f"a{suffix}"))
    assert np.array_equal(found.views, FIELD.views[1:2])


def test_webp_of_a_whole_light_field_is_an_animation():
    assert WHOLE_BY_SUFFIX[".webp"].name == "animated-webp"


def test_a_calibration_makes_a_native_picture(tmp_path):
    (tmp_path / "c.json").write_text(json.dumps(CALIBRATION))
    (note,) = WIDE.save(tmp_path / "a.png", "lenticular", calibration=tmp_path / "c.json")
    assert note.startswith("depth: the display is sharp for disparities from")
    assert np.array_equal(read(tmp_path / "a.png"), interlace(WIDE.views[0], make_calibration()))


def test_a_description_of_a_panel_makes_its_picture(tmp_path):
    (tmp_path / "p.toml").write_text(PANEL)
    notes = FIELD.save(tmp_path / "a.png", "panel", display=str(tmp_path / "p.toml"), conversion="none", disparity=0.5)
    display = parse_display(PANEL.encode(), name="p")
    expected = resample_panel(FIELD.views, display, conversion="none", disparity=0.5)
    assert np.array_equal(read(tmp_path / "a.png"), expected)
    assert Image.open(io.BytesIO((tmp_path / "a.png").read_bytes())).info["dpi"] == pytest.approx((254, 254), rel=5e-5)
    assert notes[0].startswith("viewing zone: lenses show 18.9 degrees")
    assert notes[1].startswith("depth: the display is sharp for disparities from")


@pytest.mark.parametrize("options", [{"quilt": "8x6"}, {"calibration": "c.json"}, {"display": "p.toml"}])
def test_views_that_are_not_opaque_are_laid_over_black_with_a_note(tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.json").write_text(json.dumps(CALIBRATION))
    (tmp_path / "p.toml").write_text(PANEL)
    opaque = np.pad(FIELD.views, ((0, 0),) * 4 + ((0, 1),), constant_values=255)
    half = opaque.copy()
    half[..., 3] = 128
    for views, expected in ((opaque, False), (half, True)):
        notes = LightField(views, depth_sense="cameras").save("a.png", **options)
        assert ("alpha: the views are placed on a black background" in notes) is expected


def test_what_webp_cannot_hold_is_refused_before_a_picture_is_made(folder, monkeypatch):
    monkeypatch.setattr(displays, "show_light_field", None)
    deep = LightField(FIELD.views.astype(np.uint16), depth_sense="cameras")
    for field, display, message in (
        (deep, PANEL, r"not 16 bit and 60x40 \(width x height\); name the file .png or .tif"),
        (FIELD, PANEL.replace("[60, 40]", "[17000, 40]"), r"not 8 bit and 17000x40 \(width x height\)"),
    ):
        (folder / "p.toml").write_text(display)
        with pytest.raises(InvalidOption, match=message):
            field.save("a.webp", display="p.toml")
    with pytest.raises(InvalidOption, match=r"not 16 bit and 64x48 \(width x height\)"):
        deep.save("a_qs8x6a1.webp")
    with pytest.raises(InvalidOption, match="name says qs8x6a1, so it would be read as a quilt; give the panel"):
        FIELD.save("a_qs8x6a1.png", display="p.toml")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with the files of two displays and two that are none."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.toml").write_text(PANEL)
    (tmp_path / "c.json").write_text(json.dumps(CALIBRATION))
    (tmp_path / "p.bin").write_bytes(b"\xff\xfe")
    (tmp_path / "long.toml").write_text("#" * 70_000)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "options", "error", "message"),
    [
        ("quilt", {"device": "phone"}, InvalidOption, "device: 'phone' is not known"),
        ("quilt", {"quilt": "8"}, InvalidOption, "quilt: '8' is not understood"),
        ("quilt", {"quilt": (8, 6)}, InvalidOption, r"quilt: '\(8, 6\)' is not accepted; give text"),
        ("quilt", {"aspect": "wide"}, InvalidOption, "aspect: 'wide' is not accepted; give a number"),
        ("quilt", {"disparity": 1e300}, InvalidOption, "disparity: 1e\\+300 is out of range"),
        ("quilt", {"disparity": float("nan")}, InvalidOption, "disparity: nan is out of range; give -1000 to 1000"),
        (
            "quilt",
            {"display": "p.toml"},
            InvalidOption,
            "display: format quilt has no use for it; .*format panel",
        ),
        ("lenticular", {}, InvalidOption, "calibration: a lenticular picture needs it"),
        ("panel", {}, InvalidOption, "display: a panel's picture needs it"),
        (
            "panel",
            {"display": "p.toml", "conversion": "x"},
            InvalidOption,
            "conversion: 'x' is not known; give spoc",
        ),
        ("panel", {"display": "none.toml"}, Unreadable, "none.toml: No such file"),
        ("panel", {"display": "c.json"}, Unreadable, "^c.json: not TOML but JSON; .* as the option calibration$"),
        ("lenticular", {"calibration": "p.toml"}, Unreadable, "^p.toml: not JSON; .* as the option display$"),
        ("panel", {"display": "p.bin"}, Unreadable, "p.bin: not text in UTF-8"),
        ("panel", {"display": "long.toml"}, TooLarge, "long.toml: over 65,536 bytes"),
    ],
)
def test_mistakes_are_refused_before_any_work(folder, name, options, error, message):
    with pytest.raises(error, match=message):
        FIELD.save("a.png", name, **options)
    assert not (folder / "a.png").exists()


@pytest.mark.parametrize("name", ["lenticular", "panel"])
def test_subpixels_are_not_written_as_jpeg(tmp_path, name):
    with pytest.raises(InvalidOption, match=f"{name} is written as .png or .tif or .tiff or .webp"):
        FIELD.save(tmp_path / "a.jpg", name)
