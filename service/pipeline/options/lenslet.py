"""Options of raw lenslet pictures: the known part of their lens grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

from ciir.errors import InvalidOption
from ciir.renderer.readers.lenslet.grid import LEAST_PITCH, MOST_PITCH, Known, KnownShape
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.values import check_number, make_form, make_name, make_number, write_number

Pitch = float | Literal["auto"]
GridShape = Literal["auto", KnownShape]
_NUMBER = r"[0-9]{1,6}(\.[0-9]{1,6})?"


def _parse_pitch(name: str, text: str) -> Pitch:
    return "auto" if text == "auto" else _check_pitch(name, float(text))


def _check_pitch(name: str, pitch: float) -> float:
    if not LEAST_PITCH <= pitch <= MOST_PITCH:
        raise InvalidOption(f"{name}: {pitch:g} is out of range; give {LEAST_PITCH:g} to {MOST_PITCH:g} pixels")
    return pitch


def _convert_point(value: Any) -> tuple[float, float]:
    y, x = (round(float(check_number(number)), 6) for number in value)
    if not (0 <= y < 1e6 and 0 <= x < 1e6):
        raise ValueError
    return y, x


_PITCH = make_form(
    f"auto|{_NUMBER}",
    form="pixels, such as 14.37, or auto",
    parse=_parse_pitch,
    convert=lambda value: _check_pitch("lens_pitch", float(check_number(value))),
    needed="pixels such as 14.37, or 'auto'",
    write=lambda pitch: pitch if isinstance(pitch, str) else write_number(pitch),
)
_POINT = make_form(
    f"{_NUMBER},{_NUMBER}",
    form="y,x in pixels, such as 5.3,8.8",
    parse=lambda _, text: tuple(map(float, text.split(","))),
    convert=_convert_point,
    needed="y and x in pixels, such as (5.3, 8.8)",
    write=lambda point: ",".join(map(write_number, point)),
)
LENSLET = {
    "lens_pitch": Option(
        "PIXELS",
        "for a raw lenslet picture: pixels from lens to lens, such as 14.37, or auto to find the lens grid in it",
        _PITCH,
        "auto",
    ),
    "lens_offset": Option(
        "Y,X", "with --lens-pitch: the centre of one lens, in pixels (default: found)", _POINT, "5.3,8.8"
    ),
    "lens_rotation": Option(
        "DEGREES",
        "with --lens-pitch: the angle by which rows of lenses go down to the right (default: found)",
        make_number(-45, 45, "degrees such as 0.8"),
        "0.8",
    ),
    "lens_grid": Option(
        "NAME",
        "with --lens-pitch: square, hexagonal (every other row shifted), hexagonal-columns or auto (default auto)",
        make_name(get_args(GridShape)),
        "hexagonal",
    ),
}
"""Options by name, in the order of the help."""


@dataclass(frozen=True)
class LensletOptions:
    """Values of the options in `LENSLET`."""

    lens_pitch: Pitch | None = None
    """Pixels; None for an elemental image array, whose lenses are a whole number of pixels wide."""
    lens_offset: tuple[float, float] | None = None
    lens_rotation: float | None = None
    lens_grid: GridShape = "auto"

    @property
    def known_grid(self) -> Known | None:
        """The given part of the lens grid of a raw lenslet picture, or None without `lens_pitch`.

        Raises the same errors as `check_lens_grid`.
        """
        self.check_lens_grid()
        if self.lens_pitch is None:
            return None
        return Known(
            None if self.lens_pitch == "auto" else self.lens_pitch,
            self.lens_offset,
            self.lens_rotation,
            None if self.lens_grid == "auto" else self.lens_grid,
        )

    def check_lens_grid(self) -> None:
        """Raises `InvalidOption` if another of these options is given without `lens_pitch`."""
        for name in ("lens_offset", "lens_rotation", "lens_grid"):
            if self.lens_pitch is None and getattr(self, name) != getattr(LensletOptions, name):
                raise InvalidOption(f"{name}: this needs lens_pitch; give lens_pitch in pixels, or as auto")
