"""Lenticular prints: the calibration of a sheet of paper under a sheet of upright lenses."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

from ciir.errors import InvalidOption, TooLarge
from ciir.renderer.displays.lenticular import MOST_SIDE, SEEN, UPRIGHT, Calibration, parse_calibration
from ciir.renderer.displays.screen import FIELD_OF_VIEW
from ciir.renderer.limits import DEFAULT_LIMITS

PRINT = ("print", "lpi", "dpi", "view_distance", "view_angle")
"""The names of the `FormatOptions` that describe a print."""
REMEDY = "give another print, lpi or dpi"
_PER_INCH = {"in": 1.0, "mm": 25.4}
_SPAN = 0.1, 10_000
"""The shortest and the longest length in inches."""
_NUMBER, _UNIT = r"(\d{1,6}(?:\.\d{1,6})?)", f"({'|'.join(_PER_INCH)})"


def parse_size(text: str) -> tuple[float, float]:
    """Reads `6x4in` or `152x102mm`, width x height: returns them in inches. Raises `InvalidOption`."""
    width, height = _read(rf"{_NUMBER}x{_NUMBER}{_UNIT}", text, "print: {}; give width x height, such as 6x4in")
    return width, height


def parse_distance(text: str) -> float:
    """Reads `16in` or `400mm`: returns inches. Raises `InvalidOption`."""
    (distance,) = _read(_NUMBER + _UNIT, text, "view_distance: {}; give a distance such as 16in")
    return distance


def _read(pattern: str, text: str, message: str) -> list[float]:
    match = re.fullmatch(pattern, re.sub(r"\s", "", text).lower())
    if match is None:
        what = f"{text[:40]!r} is not a length with a unit, in or mm"
        raise InvalidOption(message.format(what))
    *numbers, unit = match.groups()
    lengths = [float(number) / _PER_INCH[unit] for number in numbers]
    if not _SPAN[0] <= min(lengths) <= max(lengths) <= _SPAN[1]:
        what = f"{text[:40]!r} is out of range, {_SPAN[0]:g} to {_SPAN[1]:,} inches, 2.54 mm to 254 m"
        raise InvalidOption(message.format(what))
    return lengths


def make_calibration(
    size: str,
    lpi: float | None,
    dpi: float | None,
    *,
    view_distance: str = "",
    view_angle: float | None = None,
    max_pixels: int = DEFAULT_LIMITS.pixels,
) -> Calibration:
    """Returns the calibration of a print, as `parse_calibration` reads it from the JSON of the same print, with notes
    that name these options.

    `size`: as `parse_size` reads it. `lpi`: the lens sheet's lenses per inch. `dpi`: the printer's pixels per inch.
    `view_distance`: as `parse_distance` reads it, by default the distance from which the print is `FIELD_OF_VIEW` high,
    and at least half of the longer side.
    `view_angle`: the lens sheet's viewing angle in degrees, by default that of `parse_calibration`.

    Raises `InvalidOption` for a missing number, fewer than two pixels under a lens, lengths that don't fit one another,
    and what `parse_calibration` raises.
    """
    if not size:
        raise InvalidOption("print: its size is missing; give width x height, such as 6x4in")
    if lpi is None:
        raise InvalidOption("lpi: a print needs it; give the lens sheet's lenses per inch, such as 60")
    if dpi is None:
        raise InvalidOption("dpi: a print needs it; give the printer's pixels per inch, such as 600")
    if dpi < 2 * lpi:
        under = f"{lpi:g} lenses per inch at {dpi:g} dpi have {dpi / lpi:.3g} pixels under a lens, and at least 2 are"
        raise InvalidOption(f"lpi, dpi: {under} needed; give dpi {2 * lpi:g} or more, or fewer lpi")
    sides = parse_size(size)
    width, height = (round(side * dpi) for side in sides)
    pixels = f"print: {size[:40]} at {dpi:g} dpi is {width}x{height} pixels"
    if not 1 <= min(width, height) <= max(width, height) <= MOST_SIDE:
        raise InvalidOption(f"{pixels}, and sides have 1 to {MOST_SIDE:,}; check the unit, in or mm, and dpi")
    if width * height > max_pixels:
        smaller = "give a smaller size or fewer dpi, or check the unit, in or mm"
        raise TooLarge(f"{pixels}; at most {max_pixels:,} are made; {smaller}", "pixels")
    distance = _find_distance(view_distance, size, sides)
    numbers = {
        "pitch": lpi,
        "viewDistance": distance,
        "DPI": dpi,
        "screenW": width,
        "screenH": height,
        "slope": UPRIGHT,
        "center": 0,
        "invView": 1,
        "subpixels": "none",
        **({} if view_angle is None else {"viewCone": view_angle}),
    }
    found = parse_calibration(json.dumps(numbers).encode(), name="print", remedy=REMEDY, max_pixels=max_pixels)
    strips = found.pitch / (width / dpi)
    seen = f"print: with lpi {lpi:g} and view_distance {distance:.4g}in, {strips:.6g} strips fit into an inch"
    others = (note for note in found.notes if not note.startswith(SEEN))  # which has the words of the JSON
    return replace(found, notes=(seen, *others))


def _find_distance(view_distance: str, size: str, sides: tuple[float, float]) -> float:
    """Returns the distance of the viewer of a print of `size`, whose `sides` are in inches."""
    least = max(sides) / 2
    if not view_distance:
        return max(least, sides[1] / 2 / math.tan(math.radians(FIELD_OF_VIEW) / 2))
    distance = parse_distance(view_distance)
    if distance < least:
        near = f"view_distance: {view_distance[:40]} is under half of the longer side of {size[:40]}"
        raise InvalidOption(f"{near}; give the distance from the eyes to the print, such as 16in or 400mm")
    return distance
