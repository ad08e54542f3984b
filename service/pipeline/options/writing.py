"""Options of the output file that its format leaves open."""

from __future__ import annotations

from typing import get_args

from ciir.renderer.writers.options import RANGES, PathName, parse_epi
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.values import ValueType, make_integer, make_name, make_number


def _read_line(_: str, text: str) -> str:
    parse_epi(text.strip())
    return text.strip()


EPI = ValueType(
    {"type": "string", "pattern": "^(y=[0-9]{1,6}(,v=[0-9]{1,6})?|x=[0-9]{1,6}(,u=[0-9]{1,6})?)?$"},
    _read_line,
    parse_epi,
    "a row 'y=120' or a column 'x=80'",
)

WRITING = {
    "path": Option(
        "NAME",
        "path of the camera in a video: circle, sweep (left to right and back) or spiral (default circle)",
        make_name(get_args(PathName)),
        "sweep",
    ),
    "frames": Option("N", "frames of a video, 1 to 3600 (default 60)", make_integer(*map(int, RANGES["frames"])), "3"),
    "fps": Option(
        "RATE",
        "frames per second of a video, 1 to 240 (default 30; for several times: their own rate)",
        make_number(*RANGES["fps"]),
        "25",
    ),
    "epi": Option(
        "LINE",
        "format epi: a row of the views such as y=120, or a column such as x=80; with ,v= or ,u= added, in the views "
        "of that row or column (default: the middle row of the centre view)",
        EPI,
        "y=3",
    ),
}
"""Options by name, in the order of the help."""
