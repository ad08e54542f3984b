import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.errors import InvalidOption, TooLarge, Unreadable
from ciir.renderer.displays.integral import IntegralDisplay, parse_display

SMALLEST = """
[panel]
pixels = [30, 20]
pitch = 0.1
[lenses]
pitch = 1.0
gap = 3.0
"""
FULL = """
[panel]
pixels = [3840, 2160]
ppi = 50.8
subpixels = "bgr"
[lenses]
pitch = 1.25
gap = 3.3
grid = "hexagonal"
offset = [0.5, -0.25]
rotation = -2.5
[viewer]
distance = 600
"""


def parse(text):
    return parse_display(text.encode(), name="d.toml")


def test_all_entries_are_read():
    assert parse(FULL) == IntegralDisplay(
        3840, 2160, 0.5, 1.25, 3.3, grid="hexagonal", offset=(0.5, -0.25), rotation=-2.5, stripes="bgr", distance=600.0
    )
    assert parse(SMALLEST) == IntegralDisplay(30, 20, 0.1, 1.0, 3.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pitch = 1.0\n", "", r"lenses.pitch is missing; give a number from 0.0001 to 10000"),
        ("gap = 3.0", "gap = 'x'", r"lenses.gap is 'x'; give a number"),
        ("gap = 3.0", "gap = nan", r"lenses.gap is 'nan'; give a number"),
        ("gap = 3.0", "gap = 3.0\nppi = 25", "lenses.ppi is not known; give pitch, gap, grid, offset, rotation"),
        ("gap = 3.0", "gap = 3.0\nfocal = 3", r"lenses.focal is not known; give pitch, gap, grid, offset, rotation"),
        ("pitch = 0.1", "dpi = 600", "panel.dpi is not known; give pixels, ppi, pitch, subpixels"),
        ("gap = 3.0", "gap = 3.0\n[viewer]\nfar = 9", "viewer.far is not known; give distance"),
        ("gap = 3.0", "gap = 3.0\n[glass]", r"\[glass\] is not known; give \[panel\], \[lenses\] and \[viewer\]"),
        ("[lenses]", "[[lenses]]", r"lenses is not a table"),
        ("pitch = 0.1", "pitch = 0.1\nppi = 200", r"panel needs either pitch \(mm\) or ppi"),
        ("pitch = 0.1", "", r"panel needs either pitch \(mm\) or ppi"),
        ("[30, 20]", "[30, 20.5]", r"panel.pixels holds a fraction"),
        ("[30, 20]", "30", r"panel.pixels is '30'; give two numbers"),
        ("[30, 20]", "[0, 20]", r"panel.pixels is '0'; give numbers from 1 to 100000"),
        ("gap = 3.0", "gap = 3.0\ngrid = 'round'", r"lenses.grid is 'round'; give \"square\" or \"hexagonal\""),
        ("gap = 3.0", "gap = 3.0\n[viewer]\ndistance = 2", r"viewer.distance is 2 mm, less than the gap of 3 mm; give"),
        ("pitch = 1.0", "pitch = 0.15", r"a lens of 0.15 mm over pixels of 0.1 mm; a lens covers at least 2 pixels"),
        ("pitch = 1.0", "pitch = 2.1", r"a lens of 2.1 mm is larger than the panel of 3x2 mm; check the units"),
        (
            "gap = 3.0",
            "gap = 0.03",
            r"a lens of 1 mm with a gap of 0.03 mm shows 173 degrees; lenses show 1 to 90; check",
        ),
        ("gap = 3.0", "gap = 0.499", r"a lens of 1 mm with a gap of 0.499 mm shows 90.1 degrees"),
        ("gap = 3.0", "gap = 3000", r"a lens of 1 mm with a gap of 3000 mm shows 0.0191 degrees"),
    ],
)
def test_mistakes_are_named_with_the_remedy(old, new, message):
    with pytest.raises(InvalidOption, match=f"^d.toml: {message}"):
        parse(SMALLEST.replace(old, new))


@pytest.mark.parametrize(("viewer", "distance"), [("[viewer]\ndistance = 60", 60), ("", 120), ("", 300)])
def test_eyes_in_the_viewing_zone_see_each_lenss_own_pixels(viewer, distance):
    """A panel of 30 x 2 mm. Without a viewer, the zone begins where the directions of its outermost lenses meet."""
    display = parse(SMALLEST.replace("[30, 20]\npitch = 0.1", "[1500, 100]\npitch = 0.02") + viewer)
    (note,) = display.notes
    assert note.startswith("viewing zone: lenses show 18.9 degrees; ")
    if viewer:
        width = float(re.search(r"at 60 mm it is (\S+) mm wide", note)[1])
    else:
        width = (distance - float(re.search(r"it begins (\S+) mm from them and widens", note)[1])) / 3
    assert width > 9
    owners = display.trace_row(50)[0][:, 1, 0]
    lenses = np.arange(-14, 15.0)
    for eye, is_inside in ((0.47 * width, True), (-0.47 * width, True), (width / 2 + 1.5, False)):
        seen = lenses + (lenses - eye) * display.gap / distance  # where the eye looks through each lens
        index = np.rint(seen / 0.02 + 749.5).astype(int)
        is_own = np.abs(owners[index.clip(0, 1499)] - lenses) < 1e-6
        assert is_own.all() == is_inside


def test_depths_beyond_all_sizes_are_noted():
    """The sharp depth of lenses of 100 pixels, 1 mm, and a gap of 3 mm is 300 mm, and the panel is 31 mm wide."""
    fine = SMALLEST.replace("[30, 20]\npitch = 0.1", "[3100, 2000]\npitch = 0.01")
    assert len(parse(fine).notes) == 1
    assert parse(fine.replace("pitch = 1.0", "pitch = 1.1")).notes[1].startswith("viewing zone: check the units")


def test_what_is_no_toml_is_refused():
    message = r"^d.toml: not TOML \(Invalid value \(at line 1, column 8\)\); docs/displays.md has a file to begin with$"
    with pytest.raises(Unreadable, match=message):
        parse("grid = square")
    with pytest.raises(Unreadable, match=r"^d.toml: not TOML; docs/displays.md has a file to begin with$"):
        parse_display(b"\xff", name="d.toml")


def test_a_byte_order_mark_is_no_error():
    assert parse(f"\ufeff{SMALLEST}") == parse(SMALLEST)


def test_a_number_of_thousands_of_digits_is_named_in_any_base():
    for digits in ("9" * 5000, "0x1" + "0" * 5000):
        with pytest.raises(Unreadable, match=r"^d.toml: "):
            parse(SMALLEST.replace("[30, 20]", f"[{digits}, 20]"))


def test_a_panel_of_too_many_pixels_is_refused():
    with pytest.raises(TooLarge, match="at most 67,108,864 are made"):
        parse(SMALLEST.replace("[30, 20]", "[90000, 90000]"))


def test_a_straight_lens_array_by_hand():
    """3 pixels of 0.1 mm under each lens of 0.3 mm; the middle pixel of the panel is straight behind a lens."""
    lens, tangent = IntegralDisplay(9, 9, 0.1, 0.3, 2.0, stripes="none").trace_row(0)
    assert np.allclose(lens[:, 1, 0], np.repeat([-0.3, 0, 0.3], 3))
    assert np.allclose(lens[..., 1], 0.3)
    assert np.allclose(tangent[:, 1, 0] * 2.0, np.tile([-0.1, 0, 0.1], 3))
    assert np.allclose(tangent[..., 1] * 2.0, 0.1)  # the top row lies above the centre of its lens


def test_colours_lie_a_third_of_a_pixel_apart():
    _, tangent = IntegralDisplay(9, 9, 0.1, 0.9, 2.0).trace_row(4)
    assert np.allclose(np.diff(tangent[..., 0], axis=1) * 2.0, 0.1 / 3)
    _, tangent = IntegralDisplay(9, 9, 0.1, 0.9, 2.0, stripes="bgr").trace_row(4)
    assert np.allclose(np.diff(tangent[..., 0], axis=1) * 2.0, -0.1 / 3)


@given(
    st.sampled_from(["square", "hexagonal"]),
    st.floats(-180, 180),
    st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    st.integers(0, 2**32 - 1),
)
def test_the_lens_found_is_the_nearest_of_all(grid, rotation, offset, seed):
    display = IntegralDisplay(10, 10, 0.1, 0.8, 2.0, grid=grid, rotation=rotation, offset=offset)
    points = np.random.default_rng(seed).uniform(-2, 2, (20, 2))
    angle = math.radians(rotation)
    lenses = []
    for j in range(-14, 15):
        for i in range(-14, 15):
            x, y = (i, j) if grid == "square" else (i + 0.5 * (j % 2), j * math.sqrt(3) / 2)
            turned = x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)
            lenses.append(0.8 * np.array(turned) + offset)
    distances = np.linalg.norm(points[:, None] - np.array(lenses), axis=2)
    found = display.find_lenses(points)
    assert np.allclose(np.linalg.norm(found - points, axis=1), distances.min(axis=1))
    assert np.linalg.norm(found[:, None] - np.array(lenses), axis=2).min(axis=1).max() < 1e-9


def test_lines_of_a_near_viewer_meet_at_the_eye():
    """The middle pixel behind each lens, as the viewer sees it, sends its light to the viewer."""
    display = IntegralDisplay(800, 3, 0.1, 1.0, 3.0, distance=300.0, stripes="none")
    lens, tangent = display.trace_row(1)
    at_eye = lens[..., 0] - 300 * tangent[..., 0]
    assert np.abs(at_eye).max() <= 300 * display.tangent_range * 1.02  # no more than half the zone to each side
    far, _ = IntegralDisplay(800, 3, 0.1, 1.0, 3.0, stripes="none").trace_row(1)
    assert np.abs(lens - far).max() > 0.9  # at the border another lens is in the way


@pytest.mark.parametrize(("pixel", "lenses"), [(0.1111111111, 61), (0.11111, 61), (0.111, 60)])
def test_as_many_lenses_fit_as_do_but_for_rounding(pixel, lenses):
    assert IntegralDisplay(549, 549, pixel, 1.0, 3.0).lens_array().cols == lenses


def test_its_lens_array_covers_the_panel_and_its_directions():
    array = parse(FULL).lens_array()
    assert (array.cols, array.rows, array.pitch) == (1536, 864, 1.25)
    assert array.tangent_x().max() + array.delta / 2 == pytest.approx(1.25 / 2 / 3.3)
