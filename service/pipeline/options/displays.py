"""Options for display pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from ciir.errors import InvalidOption
from ciir.renderer.displays.devices import DEFAULT, DEVICES
from ciir.renderer.displays.panel import Conversion
from ciir.renderer.displays.quilt import parse_grid
from ciir.renderer.writers.options import MOST_TEXT, RANGES
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.values import LABEL, PAIR, ValueType, make_name, make_number


def _read_grid(_: str, text: str) -> str:
    return "{}x{}".format(*parse_grid(text)) if text.strip() else ""


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


@dataclass(frozen=True)
class DisplayOptions:
    """Values of the options in `DISPLAYS`."""

    device: str = ""
    quilt: str = ""
    aspect: float | None = None
    calibration: str = ""
    display: str = ""
    conversion: Conversion = "spoc"
    disparity: float | None = None
    """Pixels."""
