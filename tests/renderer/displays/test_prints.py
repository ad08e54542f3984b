"""Prints by their size: the calibrations are those of the JSON in docs/displays.md."""

import json
import math
import sys
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import InputError, InvalidOption, TooLarge
from ciir.renderer.displays.lenticular import parse_calibration
from ciir.renderer.displays.pictures import find_kind, find_target
from ciir.renderer.displays.prints import make_calibration, parse_size
from ciir.renderer.writers.options import WriterOptions

DOCUMENTED = {
    "pitch": 60, "viewDistance": 16, "DPI": 600, "screenW": 3600, "screenH": 2400,
    "slope": 10000, "center": 0, "viewCone": 40, "invView": 1, "subpixels": "none",
}  # fmt: skip


def parse(**changed):
    return parse_calibration(json.dumps(DOCUMENTED | changed).encode(), name="print.json")


@pytest.mark.parametrize(
    ("options", "changed"),
    [
        ({"view_distance": "16in"}, {}),
        ({"print": " 6 X 4 IN ", "view_distance": "16.0 in"}, {}),
        ({"print": "152.4x101.6mm", "view_distance": "406.4mm"}, {}),
        ({"view_distance": "16in", "view_angle": 54}, {"viewCone": 54}),
        ({"print": "100x150mm", "dpi": 720, "lpi": 75, "view_distance": "20in"},
         {"screenW": 2835, "screenH": 4252, "DPI": 720, "pitch": 75, "viewDistance": 20}),
        ({}, {"viewDistance": 2 / math.tan(math.radians(7))}),
    ],
)  # fmt: skip
def test_a_print_has_the_calibration_of_its_json(options, changed):
    written = WriterOptions(**({"print": "6x4in", "lpi": 60, "dpi": 600} | options))
    assert find_kind(written) == "lenticular"
    assert replace(find_target("lenticular", written), notes=()) == replace(parse(**changed), notes=())


def test_notes_name_the_options_of_a_print():
    seen = "print: with lpi 60 and view_distance {}in, {} strips fit into an inch"
    assert make_calibration("6x4in", 60, 600, view_distance="406.4mm").notes == (seen.format(16, 59.9143),)
    assert make_calibration("6x4in", 60, 600).notes == (seen.format(16.29, 59.9158),)
    _, note = make_calibration("6x4in", 1, 600).notes
    assert note.startswith("depth: detail would be sharp up to ")
    assert note.endswith(" heights of the screen from it; give another print, lpi or dpi")


def test_the_default_distance_is_one_that_is_accepted():
    wide = make_calibration("20x2in", 20, 60)
    assert wide.notes[0].startswith("print: with lpi 20 and view_distance 10in, ")
    assert wide == make_calibration("20x2in", 20, 60, view_distance="10in")


def test_the_strips_are_upright():
    for found in (make_calibration("1x4in", 40, 200), parse(), parse(slope=-10000)):
        assert (found.view_places(0) == found.view_places(found.height - 1)).all()
    assert not (parse(slope=9999).view_places(0) == parse(slope=9999).view_places(2399)).all()


def test_without_a_distance_the_perspective_is_that_of_any_display():
    assert make_calibration("6x4in", 60, 600).field_of_view == pytest.approx(parse().__class__.field_of_view)


@settings(max_examples=50)
@given(st.floats(2.54, 9999), st.floats(2.54, 9999))
def test_millimetres_are_converted(width, height):
    inches, metric = (f"{width:.3f}x{height:.3f}{unit}" for unit in ("in", "mm"))
    assert parse_size(inches) == pytest.approx([25.4 * side for side in parse_size(metric)])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"print": ""}, "print: its size is missing; give width x height"),
        ({"print": "6x4"}, "print: '6x4' is not a length with a unit, in or mm; give width x height, such as 6x4in"),
        ({"print": "6x4cm"}, "print: '6x4cm' is not a length with a unit, in or mm"),
        ({"print": "6x0in"}, "print: '6x0in' is out of range, 0.1 to 10,000 inches, 2.54 mm to 254 m; give"),
        ({"view_distance": "400000mm"}, "view_distance: '400000mm' is out of range, 0.1 to 10,000 inches"),
        ({"lpi": None}, "lpi: a print needs it; give .* such as 60"),
        ({"dpi": None}, "dpi: a print needs it; give .* such as 600"),
        ({"lpi": 400}, r"lpi, dpi: 400 lenses per inch at 600 dpi have 1\.5 pixels .* 2 are needed; give dpi 800 or"),
        ({"print": "152x102in"}, r"152x102in at 600 dpi is 91200x61200 pixels; at most [0-9,]+ are made; .*unit"),
        ({"print": "1000x0.5in"}, "is 600000x300 pixels, and sides have 1 to 100,000; check the unit, in or mm"),
        ({"print": "0.1x0.1in", "lpi": 1, "dpi": 2}, "is 0x0 pixels, and sides have 1 to 100,000"),
        (
            {"print": "0.1x0.1in", "lpi": 4},
            "screen: 0.217, and at least 1 is needed; give another print, lpi or dpi",
        ),
        ({"view_distance": "16"}, "view_distance: '16' is not a length .*; give a distance such as 16in"),
        ({"view_distance": "16mm"}, "view_distance: 16mm is under half of the longer side of 6x4in; give the distance"),
        ({"calibration": json.dumps(DOCUMENTED)}, "print, calibration: both describe the display; leave one of them"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(options, message):
    written = WriterOptions(**({"print": "6x4in", "lpi": 60, "dpi": 600} | options))
    with pytest.raises(InputError, match=message) as caught:
        find_target("lenticular", written)
    assert "\n" not in str(caught.value)


def test_a_limit_on_pixels_that_would_suffice_is_not_named():
    assert make_calibration("6x4in", 60, 600, max_pixels=3600 * 2400).width == 3600
    with pytest.raises(TooLarge, match="3600x2400 pixels; at most 8,639,999 are made"):
        make_calibration("6x4in", 60, 600, max_pixels=3600 * 2400 - 1)
    assert make_calibration("100x100in", 60, 900, max_pixels=sys.maxsize).height == 90_000


@pytest.mark.parametrize("name", ["lpi", "dpi", "view_angle"])
def test_numbers_have_a_range(name):
    with pytest.raises(InvalidOption, match=f"^{name}: 0 is out of range; give 1 to"):
        WriterOptions.convert({"print": "6x4in", name: 0})
