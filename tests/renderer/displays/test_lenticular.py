"""Native pictures, against one that is cast ray by ray from the formula as it is published."""

import json
import math
import re
import tracemalloc

import numpy as np
import pytest

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.displays.integral import INCH, IntegralDisplay
from ciir.renderer.displays.lenticular import INVERTED, UNTESTED, interlace, parse_calibration
from ciir.renderer.displays.light_fields import pad_to_aspect
from ciir.renderer.displays.panel import resample_panel
from ciir.renderer.displays.quilt import QuiltLayout, join_views, split_quilt
from ciir.renderer.displays.rays import RayCaster
from ciir.renderer.displays.screen import Screen
from tests.support.displays import CALIBRATION, load_at, make_calibration
from tests.support.paths import ROOT, SHARED

QUILT = QuiltLayout(8, 6, 1.5)
BACKGROUND = (30, 60, 90)
TOLERANCE = 2.0
"""Levels."""
FINE = 16
"""Rays from one view to the next, to find edges."""
SHRUNK = 8


def value(name, changed):
    return changed.get(name, CALIBRATION[name]["value"])


def trace_subpixels(changed, rows):
    """Camera and screen point of every subpixel of `rows`, `(n, w, 3, 3)` each: the published formula, one subpixel at
    a time."""
    width, height = int(value("screenW", changed)), int(value("screenH", changed))
    slope, flip_x, flip_y = (value(name, changed) for name in ("slope", "flipImageX", "flipImageY"))
    pitch = value("pitch", changed) * width / value("DPI", changed) * math.cos(math.atan(1 / slope))
    tilt = height / (width * slope) * (-1 if flip_x else 1)
    distance = 0.5 / math.tan(math.radians(7))
    cameras, points = np.empty((len(rows), width, 3, 3)), np.empty((len(rows), width, 3, 3))
    for row, column, color in np.ndindex(len(rows), width, 3):
        x, y = (column + 0.5) / width, 1 - (rows[row] + 0.5) / height
        place = color if not value("flipSubp", changed) else 2 - color
        a = (x + place / (3 * width) + y * tilt) * pitch - value("center", changed)
        z = a % 1.0
        z = 1 - z if value("invView", changed) else z
        angle = math.radians((z - 0.5) * value("viewCone", changed))
        x, y = (1 - x if flip_x else x), (1 - y if flip_y else y)
        cameras[row, column, color] = distance * math.tan(angle), 0, distance
        points[row, column, color] = (x - 0.5) * width / height, y - 0.5, 0
    return cameras, points


def cast(caster, cameras, points):
    """The colour of each subpixel, `(h, w, 3)`."""
    colors = caster.cast(cameras.reshape(-1, 3), (points - cameras).reshape(-1, 3)).reshape(points.shape)
    return np.diagonal(colors, axis1=2, axis2=3)


def find_edges(caster, cameras, points, views, cone):
    """Where colour has a step or a kink between the two views that a subpixel blends: at silhouettes, creases and
    texels. There its slope changes by over a level a view within a sixteenth of the way; a blend would be `TOLERANCE`
    off a smooth colour whose slope changed by a level in each sixteenth.
    """
    distance = cameras[0, 0, 0, 2]
    place = (np.arctan(cameras[..., 0] / distance) / np.radians(cone) + 0.5) * (views - 1)
    left = np.minimum(np.floor(place), views - 2)
    colors = []
    for step in np.arange(FINE + 1) / FINE:
        camera = cameras.copy()
        camera[..., 0] = distance * np.tan(np.radians(cone) * ((left + step) / (views - 1) - 0.5))
        colors.append(cast(caster, camera, points))
    return np.abs(np.diff(colors, n=2, axis=0)).max(axis=0) * FINE > 1


def compare(name, layout=QUILT, rows=slice(None), **changed):
    """How far a quilt's native picture is off the rays' where no edge is: `(n,)` levels; and the share of edges."""
    calibration = make_calibration(**changed)
    screen = Screen(calibration.aspect, calibration.cone)
    caster = RayCaster(load_at(name, screen.lens_array()), BACKGROUND)
    size = calibration.height, calibration.width
    quilt = join_views(screen.render_views(caster, QUILT.count, size), QUILT)
    native = interlace(split_quilt(quilt, layout, name="q.png"), calibration)[rows]
    cameras, points = trace_subpixels(changed, range(calibration.height)[rows])
    is_edge = find_edges(caster, cameras, points, QUILT.count, calibration.cone)
    return np.abs(native - cast(caster, cameras, points))[~is_edge], is_edge.mean()


@pytest.mark.parametrize("name", ["vase", "globe", "duck.glb"])
def test_a_quilt_becomes_the_native_picture_that_rays_make(name):
    differences, edges = compare(name)
    assert differences.max() <= TOLERANCE
    assert edges < 0.4


@pytest.mark.parametrize("name", ["globe", "hamburger", "duck.glb"])
def test_so_it_does_with_a_real_displays_calibration(name):
    """On an eighth of its pixels along each side; lenses cover as many of them as on all."""
    path = SHARED / "data" / "displays" / "looking-glass-2k.json"
    if not path.exists():
        pytest.skip("needs ../shared")
    numbers = {key: entry["value"] for key, entry in json.loads(path.read_bytes()).items() if isinstance(entry, dict)}
    size = {key: numbers[key] / SHRUNK for key in ("screenW", "screenH", "DPI")}
    differences, edges = compare(name, rows=slice(0, None, SHRUNK), **numbers | size)
    assert differences.max() <= TOLERANCE
    assert edges < 0.4


@pytest.mark.parametrize(
    "changed",
    [
        {"invView": 1.0},
        {"flipImageX": 1.0},
        {"flipImageY": 1.0},
        {"flipSubp": 1.0},
        {"slope": -5.2, "center": -0.4, "viewCone": 53.0},
    ],
    ids=str,
)
def test_each_number_of_the_calibration_counts(changed):
    assert compare("vase", **changed)[0].max() <= TOLERANCE


def test_columns_and_rows_exchanged_fail():
    differences, _ = compare("vase", QuiltLayout(QUILT.rows, QUILT.cols, QUILT.aspect))
    assert np.mean(differences > TOLERANCE) > 0.1


@pytest.mark.parametrize("key", ["invView", "flipImageX", "flipImageY", "flipSubp"])
def test_flags_change_the_picture(key):
    views = np.random.default_rng(0).integers(0, 256, (5, 16, 24, 3), np.uint8)
    one, other = interlace(views, make_calibration()), interlace(views, make_calibration(**{key: 1.0}))
    assert np.mean(one != other) > 0.2


def test_prints_have_all_colours_of_a_pixel_at_one_place():
    plain = parse_calibration(json.dumps(CALIBRATION | {"subpixels": "none"}).encode(), name="c.json")
    places = plain.view_places(3)
    assert np.array_equal(places, make_calibration().view_places(3)[:, [0, 0, 0]])
    assert plain.directions == make_calibration().directions / 3
    grey = np.random.default_rng(0).integers(0, 256, (5, 16, 24, 1), np.uint8)
    assert np.ptp(interlace(grey, plain), axis=2).max() == 0
    bgr = parse_calibration(json.dumps(CALIBRATION | {"subpixels": "bgr"}).encode(), name="c.json")
    assert bgr == make_calibration(flipSubp=1.0)


def read_documented_print():
    """The calibration of a print in docs/displays.md."""
    (found,) = re.findall(r"```json\n(.*?)```", (ROOT / "docs/displays.md").read_text(), re.DOTALL)
    return json.loads(found)


@pytest.mark.parametrize("inverted", [1, 0])
def test_lenses_of_the_documented_print_have_the_order_of_a_panels(inverted):
    """The views, from the left, have rising levels, which fall from left to right under a lens: the pixel at its left
    is seen from the right. Both pictures are 18 whole lenses wide.
    """
    numbers = read_documented_print()
    columns = round(numbers["DPI"] / numbers["pitch"])
    del numbers["viewDistance"]  # whole lenses
    changed = numbers | {"screenW": 18 * columns, "screenH": 2 * columns} | ({} if inverted else {"invView": 0})
    calibration = parse_calibration(json.dumps(changed).encode(), name="c.json")
    assert calibration.notes == ((UNTESTED,) if inverted else (INVERTED, UNTESTED))
    views = np.broadcast_to(np.linspace(0, 255, 48).round().astype(np.uint8)[:, None, None, None], (48, 4, 36, 1))
    lens, pixel = INCH / numbers["pitch"], INCH / numbers["DPI"]
    display = IntegralDisplay(18 * columns, 2 * columns, pixel, lens, 3 * lens, offset=(lens / 2, 0), stripes="none")
    both = interlace(views, calibration), resample_panel(views[None], display)
    prints, panels = (found[columns, :, 0] for found in both)
    assert (np.diff(panels.reshape(18, columns).astype(int)) < 0).all()
    orders = [np.argsort(levels.reshape(18, columns)).tolist() for levels in (prints, panels)]
    assert (orders[0] == orders[1]) == bool(inverted)


def test_a_calibration_without_invview_is_noted_for_a_print_only():
    numbers = read_documented_print()
    del numbers["invView"]
    del numbers["viewDistance"]
    assert parse_calibration(json.dumps(numbers).encode(), name="c.json").notes == (INVERTED, UNTESTED)
    del numbers["subpixels"]
    assert parse_calibration(json.dumps(numbers).encode(), name="c.json").notes == ()


@pytest.mark.parametrize(
    "changed", [{}, {"slope": 6}, {"slope": -6, "center": 0.3}, {"flipImageX": 1, "slope": 6}], ids=str
)
def test_an_eye_at_the_view_distance_sees_one_view_through_all_lenses(changed):
    """It looks through a point of the sheet at one of the print farther out, which has to show what the sheet's own
    calibration shows at the point.
    """
    numbers = read_documented_print() | changed
    near = parse_calibration(json.dumps(numbers).encode(), name="c.json")
    assert near.notes == ("calibration: seen from 16 inches, the pitch of 60 becomes 59.9143",)
    del numbers["viewDistance"]
    sheet = parse_calibration(json.dumps(numbers).encode(), name="c.json")
    gap = 1 / 60 / 2 / math.tan(math.radians(20))
    size, rows = np.array([3600, 2400]), np.array([0, 700, 2399])
    places = np.stack([near.view_places(row)[:, 0] for row in rows])
    x, y = np.meshgrid(np.arange(3600) + 0.5, size[1] - (rows + 0.5))
    x, y = ((side - full / 2) * 16 / (16 + gap) + full / 2 for side, full in zip((x, y), size, strict=True))
    through = ((x / size[0] + y / size[1] * sheet.tilt) * sheet.pitch - sheet.center) % 1
    off = np.abs(places - (1 - through))
    assert np.minimum(off, 1 - off).max() < 1e-6
    assert near.sharp == pytest.approx(sheet.sharp, rel=0.01)
    assert 1200 / math.tan(math.radians(near.field_of_view) / 2) / 600 == pytest.approx(16)


@pytest.mark.parametrize(
    ("stripes", "pitch", "message"),
    [
        ("none", 600, "pixels under a lens: 1, and at least 2 are needed; check pitch, the lenses per inch, and DPI"),
        ("none", 301, "pixels under a lens: 1.993,"),
        ("rgb", 901, "subpixels under a lens: 1.998,"),
        ("none", 300, None),
        ("rgb", 900, None),
    ],
)
def test_lenses_that_cover_fewer_than_two_places_are_refused(stripes, pitch, message):
    numbers = read_documented_print() | {"subpixels": stripes, "pitch": pitch, "DPI": 600}
    del numbers["viewDistance"]
    if message is None:
        assert parse_calibration(json.dumps(numbers).encode(), name="c.json").directions == pytest.approx(2)
        return
    with pytest.raises(Unreadable, match=f"^c.json: {message}"):
        parse_calibration(json.dumps(numbers).encode(), name="c.json")


def test_rays_make_the_same_native_picture_directly():
    calibration = make_calibration()
    screen = Screen(QUILT.aspect, calibration.cone)
    caster = RayCaster(load_at("globe", screen.lens_array()), BACKGROUND)
    difference = screen.render_native(caster, calibration) - cast(caster, *trace_subpixels({}, range(80)))
    assert np.mean(np.abs(difference) > 0.51) < 1e-3  # of rays that graze an edge


def test_grey_16_bit_views_keep_their_depth():
    views = np.full((3, 8, 12, 1), 40000, np.uint16)
    native = interlace(views, make_calibration())
    assert native.dtype == np.uint16
    assert (native == 40000).all()


@pytest.mark.parametrize("own", [0.7, 1.5, 8.0])
def test_borders_are_those_of_padded_views(own):
    views = np.random.default_rng(0).integers(0, 256, (5, 31, 40, 3), np.uint8)
    calibration = make_calibration()
    padded, _ = pad_to_aspect(views, own, calibration.aspect)
    assert np.array_equal(interlace(views, calibration, own_aspect=own), interlace(padded, calibration))


def test_borders_take_no_memory():
    views = np.full((48, 100, 100, 3), 9, np.uint8)
    calibration = make_calibration(screenW=3000.0, screenH=10.0)
    tracemalloc.start()
    interlace(views, calibration, own_aspect=1.0)
    assert tracemalloc.get_traced_memory()[1] < 48 * 100 * 30000 * 3 / 10
    tracemalloc.stop()


def test_a_real_calibration_is_read():
    path = SHARED / "data" / "displays" / "looking-glass-2k.json"
    if not path.exists():
        pytest.skip("needs ../shared")
    found = parse_calibration(path.read_bytes(), name=path.name)
    assert (found.width, found.height, found.cone, found.center) == (2560, 1600, 40.0, 0.0)
    assert found.pitch == pytest.approx(49.91 * 2560 / 338 * math.cos(math.atan(1 / 5.8)))
    assert found.tilt == pytest.approx(1600 / 2560 / 5.8)


def test_a_calibration_may_be_an_entry_of_an_object():
    wrapped = json.dumps({"serial": "TEST", "calibration": CALIBRATION}).encode()
    assert parse_calibration(wrapped, name="c.json") == make_calibration()
    with pytest.raises(Unreadable, match=r"^c.json: no calibration; .* the object that holds pitch, slope, center"):
        parse_calibration(b'{"calibration": {}}', name="c.json")


def test_a_calibration_may_be_a_reply_of_looking_glass_bridge():
    text = {"calibration": {"value": json.dumps(CALIBRATION)}}
    for reply in ({"devices": [{"serial": "TEST", "calibration": CALIBRATION}]}, text, {"devices": [text]}):
        assert parse_calibration(json.dumps(reply).encode(), name="c.json") == make_calibration()
    two = json.dumps({"devices": [{"calibration": CALIBRATION}] * 2}).encode()
    with pytest.raises(Unreadable, match=r"^c.json: no calibration; .* the object that holds pitch, slope, center"):
        parse_calibration(two, name="c.json")


@pytest.mark.parametrize(("wrong", "right"), [("invview", "invView"), ("VIEWCONE", "viewCone"), ("dpi", "DPI")])
def test_a_key_in_other_case_is_refused(wrong, right):
    for numbers in (CALIBRATION, {key: value for key, value in CALIBRATION.items() if key != right}):
        with pytest.raises(Unreadable, match=f"^c.json: {wrong} is not known; write {right}$"):
            parse_calibration(json.dumps(numbers | {wrong: 1}).encode(), name="c.json")


def test_lenses_wider_than_the_screen_are_refused_and_few_are_noted():
    with pytest.raises(Unreadable, match=r"^c.json: lenses across the screen: 0.99, .* check pitch, .* and DPI"):
        make_calibration(screenW=1200.0, screenH=800.0, pitch=0.283)
    (note,) = make_calibration(screenW=1200.0, screenH=800.0, pitch=3.0).notes
    assert re.fullmatch(
        "depth: detail would be sharp up to .* from it; check pitch, the lenses per inch, and DPI", note
    )


def test_a_pattern_of_subpixels_is_noted():
    assert make_calibration().notes == ()
    assert "treated as stripes" in make_calibration(CellPatternMode=2.0).notes[0]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"{", "not JSON"),
        (b"[]", "no calibration"),
        (b'{"screenW": 9, "screenH": 9, "DPI": "x"}', "DPI is the text 'x'; give a number from 1 to 100000"),
        (b'{"screenW": 9, "screenH": 9, "DPI": 300, "slope": 0, "pitch": 40}', "slope is 0; give .* 10000 for"),
        (b'{"screenW": "9"}', "screenW is the text '9'; give a number from 1 to 100000"),
        (b'{"screenW": NaN}', "screenW is nan"),
        (json.dumps(CALIBRATION | {"subpixels": "x"}).encode(), "subpixels is 'x'; give 'rgb' or 'bgr' or 'none'"),
        (b'{"screenH": 9}', "screenW is missing; give a number from"),
    ],
)
def test_what_is_no_calibration_is_refused(data, message):
    with pytest.raises(Unreadable, match=f"^c.json: {message}"):
        parse_calibration(data, name="c.json")


def test_a_screen_of_too_many_pixels_is_refused():
    with pytest.raises(TooLarge, match="at most 67,108,864 are made"):
        make_calibration(screenW=90000.0, screenH=90000.0)
