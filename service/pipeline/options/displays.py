"""Options for display pictures."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, get_args

from ciir.errors import InvalidOption
from ciir.renderer.displays.devices import DEFAULT, DEVICES
from ciir.renderer.displays.panel import Conversion
from ciir.renderer.displays.prints import parse_distance, parse_size
from ciir.renderer.displays.quilt import parse_grid
from ciir.renderer.writers.options import MOST_TEXT, RANGES
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.values import LABEL, PAIR, TEXT, ValueType, make_name, make_number

if TYPE_CHECKING:
    from collections.abc import Callable


def _read_grid(_: str, text: str) -> str:
    return "{}x{}".format(*parse_grid(text)) if text.strip() else ""


def _make_length(number: str, parse: Callable[[str], object], needed: str) -> ValueType:
    """Makes a type for texts of lengths in one of two units, which `parse` checks."""

    def read(_: str, text: str) -> str:
        bare = re.sub(r"\s", "", text).lower()
        if bare:
            parse(text)
        return bare

    return ValueType({"type": "string", "pattern": f"^({number}(in|mm))?$"}, read, TEXT.convert, needed)


def _read_file(name: str, text: str) -> str:
    if len(text) > MOST_TEXT:
        raise InvalidOption(f"{name}: over {MOST_TEXT:,} characters; give the file that describes the display")
    return text


GRID = ValueType(
    {"type": "string", "pattern": "^([0-9]{1,6}x[0-9]{1,6})?$"},
    _read_grid,
    lambda pair: "{}x{}".format(*PAIR.convert(pair)),
    "columns and rows, such as (8, 6)",
)
_LENGTH = r"[0-9]{1,6}(\.[0-9]{1,6})?"
SIZE = _make_length(f"{_LENGTH}x{_LENGTH}", parse_size, "width x height with a unit, such as '6x4in'")
LENGTH = _make_length(_LENGTH, parse_distance, "a length with a unit, such as '16in'")
TEXT_FILE = ValueType({"type": "string", "maxLength": MOST_TEXT}, _read_file, bytes.decode, "the file's text")

DISPLAYS = {
    "device": Option(
        "NAME",
        f"quilt: the Looking Glass display that it is for: {', '.join(DEVICES)} (default: one that shows as many views "
        f"as a row of the light field has, otherwise {DEFAULT})",
        LABEL,
        "go",
    ),
    "quilt": Option("CxR", "quilt: columns x rows of views, instead of the device's", GRID, "8x6"),
    "aspect": Option(
        "NUMBER",
        "quilt: width / height of a view as the display shows it, instead of the device's",
        make_number(*RANGES["aspect"]),
        "0.75",
    ),
    "calibration": Option(
        "FILE",
        "lenticular: the JSON file with the display's calibration, which is stored on the display",
        TEXT_FILE,
        '{"pitch": 49.9, "slope": 5.8, "center": 0.3, "DPI": 338, "screenW": 120, "screenH": 80}',
    ),
    "print": Option(
        "WxH",
        "lenticular: a print under a sheet of upright lenses, instead of a calibration: its width x height, such as "
        "6x4in or 152x102mm; needs --lpi and --dpi",
        SIZE,
        "1x0.5in",
    ),
    "lpi": Option("N", "with --print: lenses per inch of the sheet", make_number(*RANGES["lpi"]), "60"),
    "dpi": Option("N", "with --print: pixels per inch of the printer", make_number(*RANGES["dpi"]), "150"),
    "view_distance": Option(
        "LENGTH",
        "with --print: distance from which it is seen, such as 16in or 400mm (default: about 4 times its height)",
        LENGTH,
        "16in",
    ),
    "view_angle": Option(
        "DEGREES", "with --print: viewing angle of the sheet (default 40)", make_number(*RANGES["view_angle"]), "40"
    ),
    "display": Option(
        "FILE",
        "panel: a TOML file that describes the panel and its lenses in millimetres, as in docs/displays.md",
        TEXT_FILE,
        "[panel]\npixels = [60, 40]\npitch = 0.1\n[lenses]\npitch = 1.0\ngap = 3.0\n",
    ),
    "conversion": Option(
        "NAME",
        "panel: spoc, for correct depth (orthoscopic); none, as lenses pick it up, with inverted depth (default spoc)",
        make_name(get_args(Conversion)),
        "none",
    ),
    "disparity": Option(
        "PIXELS",
        "for a light field: the disparity of content that should lie in the display's plane, in pixels of the views as "
        "they are shown, so after --model (default 0)",
        make_number(*RANGES["disparity"]),
        "0.5",
    ),
}
"""Options by name, in the order of the help."""
