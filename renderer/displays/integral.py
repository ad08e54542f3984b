"""Integral displays: a panel of pixels under a lens array, in millimetres."""

from __future__ import annotations

import codecs
import math
import tomllib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from ciir.errors import InvalidOption, TooLarge, Unreadable
from ciir.renderer.lens_array import LensArray
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

Grid = Literal["square", "hexagonal"]
Stripes = Literal["rgb", "bgr", "none"]
ENTRIES = {
    "panel": ("pixels", "ppi", "pitch", "subpixels"),
    "lenses": ("pitch", "gap", "grid", "offset", "rotation"),
    "viewer": ("distance",),
}
"""Entries of each table of a display's TOML file."""
INCH = 25.4
"""Millimetres."""
ROUNDING = 1e-3
"""Share of a lens that may be missing where a whole number of them fits: lengths are written with few digits."""
ANGLES = 1.0, 90.0
"""Degrees that a lens may show. A lens in air is at most twice as wide as its focal length (f/0.5, by the sine
condition), which is 90; with less than 1, only viewers over 3.7 m away have both eyes in the viewing zone."""
DEEP = 10.0
"""Sharp depth, in sizes of the display, above which lengths are probably in a wrong unit."""


@dataclass(frozen=True)
class IntegralDisplay:
    """A panel in the plane z = -gap and lenses in the plane z = 0, seen from z > 0; all lengths are in millimetres.

    x grows to the right and y upwards as the viewer sees them, from the panel's centre. A lens sends the light of a
    pixel behind it along the line from that pixel through its centre.
    """

    width: int
    """Pixels across the panel."""
    height: int
    pixel_pitch: float
    """Distance between neighbouring pixels."""
    lens_pitch: float
    """Distance between the centres of neighbouring lenses."""
    gap: float
    """Distance from the panel to the lenses, in air: thickness / refractive index if there is glass."""
    grid: Grid = "square"
    """hexagonal: rows of lenses are `sqrt(3)/2` pitches apart, every second one half a pitch to the right."""
    offset: tuple[float, float] = (0.0, 0.0)
    """x and y of the centre of a lens."""
    rotation: float = 0.0
    """Rotation of the lens array about that lens, in degrees counterclockwise."""
    stripes: Stripes = "rgb"
    """The colours of a pixel's thirds from the left; none: a pixel's colours lie at the same place."""
    distance: float = math.inf
    """Distance from the lenses to the viewer, for whom each lens shows the pixels around its centre; inf: for a viewer
    far away, each pixel belongs to the lens straight in front of it."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the panel."""
        return self.width * self.pixel_pitch, self.height * self.pixel_pitch

    @property
    def ppi(self) -> float:
        """Pixels per inch."""
        return INCH / self.pixel_pitch

    @property
    def tangent_step(self) -> float:
        """Step in tangent between neighbouring pixels under a lens."""
        return self.pixel_pitch / self.gap

    @property
    def tangent_range(self) -> float:
        """Tangent from the axis to the edge of what a lens shows along x: the panel's angular limit."""
        return self.lens_pitch / (2 * self.gap)

    @property
    def angle(self) -> float:
        """Degrees between the outermost directions that a lens shows along x."""
        return 2 * math.degrees(math.atan(self.tangent_range))

    @property
    def sharp(self) -> float:
        """Depth in front of and behind the lenses up to which detail is as fine as they are: there the lines of
        neighbouring pixels under a lens are as far apart as the lenses (Zwicker et al., EGSR 2006)."""
        return self.lens_pitch / self.tangent_step

    @property
    def notes(self) -> tuple[str, ...]:
        """Where the viewing zone is, in which no eye sees the image of a neighbouring lens; and lengths that are
        probably in a wrong unit.
        """
        if math.isfinite(self.distance):
            width = 2 * self.tangent_range * (self.gap + self.distance)
            zone = f"at {self.distance:g} mm it is {width:.3g} mm wide"
        else:
            least = max(self.size) / (2 * self.tangent_range)
            zone = f"without viewer.distance, it begins {least:.3g} mm from them and widens from there"
        deep = f"viewing zone: check the units: detail would be sharp up to {self.sharp:.2g} mm from the lenses"
        return (
            f"viewing zone: lenses show {self.angle:.3g} degrees; {zone}",
            *((deep,) if self.sharp > DEEP * max(self.size) else ()),
        )

    def fit_views(self, size: tuple[int, int], pixel_aspect: float) -> tuple[float, float]:
        """Returns height and width of a pixel of views of `size`, height and width, that just fit into the panel."""
        height = min(self.size[0] / (size[1] * pixel_aspect), self.size[1] / size[0])
        return height, height * pixel_aspect

    def lens_array(self) -> LensArray:
        """Returns the lenses that fit over the panel and the directions of the pixels under one, for `frame_scene`."""
        cols, rows = (max(1, int(side / self.lens_pitch + ROUNDING)) for side in self.size)
        pixels = max(1, round(self.lens_pitch / self.pixel_pitch))
        return LensArray(rows, cols, pixels, pixels, pitch=self.lens_pitch, delta=2 * self.tangent_range / pixels)

    def trace_row(self, row: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the lens of each subpixel of `row`, from the top, and the tangents of its line: `(width, 3, 2)` each.

        The line of a subpixel goes through its lens's centre `(x, y, 0)` along `(tx, ty, -1)`, away from the viewer.
        The last axis is x and y, the one before it red, green, blue.
        """
        thirds = {"rgb": (-1 / 3, 0, 1 / 3), "bgr": (1 / 3, 0, -1 / 3), "none": (0, 0, 0)}[self.stripes]
        pixel = np.empty((self.width, 3, 2))
        pixel[..., 0] = (np.arange(self.width)[:, None] - (self.width - 1) / 2 + np.array(thirds)) * self.pixel_pitch
        pixel[..., 1] = ((self.height - 1) / 2 - row) * self.pixel_pitch
        lens = self.find_lenses(pixel / (1 + self.gap / self.distance))
        return lens, (pixel - lens) / self.gap

    def find_lenses(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the centre of the lens that is nearest to each of `points`, `(..., 2)`."""
        angle = math.radians(self.rotation)
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        local = (points - self.offset) @ turn.T  # along the rows of lenses
        if self.grid == "square":
            nearest = np.rint(local / self.lens_pitch) * self.lens_pitch
        else:  # two rectangular grids, one in the middles of the other's cells
            cell = np.array([self.lens_pitch, self.lens_pitch * math.sqrt(3)])
            even = np.rint(local / cell) * cell
            odd = (np.floor(local / cell) + 0.5) * cell
            is_even = ((local - even) ** 2).sum(-1) <= ((local - odd) ** 2).sum(-1)
            nearest = np.where(is_even[..., None], even, odd)
        centers: NDArray[np.float64] = nearest @ turn + self.offset
        return centers


def parse_display(data: bytes, *, name: str, max_pixels: int = DEFAULT_LIMITS.pixels) -> IntegralDisplay:
    """Returns the display in a TOML file of three tables, all lengths in millimetres:

    - `[panel]`: `pixels = [width, height]`; `pitch`, or `ppi`; `subpixels = "rgb"`, `"bgr"` or `"none"`.
    - `[lenses]`: `pitch`, `gap`; `grid = "square"` or `"hexagonal"`; `offset = [x, y]`; `rotation` in degrees.
    - `[viewer]`: `distance`.

    Raises `Unreadable` if it isn't TOML, `InvalidOption` if an entry is missing, unknown or out of range, `TooLarge`
    over `max_pixels`.
    """
    panel, lenses, viewer = _load(data, name)
    width, height = panel.pair("pixels", 1, 1e5)
    if width != int(width) or height != int(height):
        raise InvalidOption(f"{name}: panel.pixels holds a fraction; give whole numbers, as in [3840, 2160]")
    if width * height > max_pixels:
        raise TooLarge(f"{name}: a panel of {width:.0f}x{height:.0f} pixels; at most {max_pixels:,} are made", "pixels")
    if panel.has("pitch") == panel.has("ppi"):
        raise InvalidOption(f"{name}: panel needs either pitch (mm) or ppi; add or remove one")
    display = IntegralDisplay(
        width=int(width),
        height=int(height),
        pixel_pitch=panel.number("pitch", 1e-4, 1e3) if panel.has("pitch") else INCH / panel.number("ppi", 0.1, 1e5),
        stripes=panel.word("subpixels", "rgb", get_args(Stripes)),
        lens_pitch=lenses.number("pitch", 1e-4, 1e4),
        gap=lenses.number("gap", 1e-4, 1e5),
        grid=lenses.word("grid", "square", get_args(Grid)),
        offset=lenses.pair("offset", -1e5, 1e5, (0.0, 0.0)),
        rotation=lenses.number("rotation", -360, 360, 0.0),
        distance=viewer.number("distance", 1e-3, 1e9, math.inf),
    )
    _check_lengths(display, name)
    return display


def _load(data: bytes, name: str) -> list[_Table]:
    """Returns the file's tables, in the order of `ENTRIES`."""
    try:
        found = tomllib.loads(data.decode("utf-8-sig"))
        str(found)  # raises ValueError for hexadecimal numbers that are too long for messages
    except (ValueError, RecursionError) as error:  # not UTF-8, not TOML, or a number with thousands of digits
        why = f" ({clean_text(str(error))[:100]})" if isinstance(error, tomllib.TOMLDecodeError) else ""
        remedy = "docs/displays.md has a file to begin with"
        if data.lstrip(codecs.BOM_UTF8).lstrip().startswith(b"{"):
            why, remedy = " but JSON", "give a lenticular display's calibration as the option calibration"
        raise Unreadable(f"{name}: not TOML{why}; {remedy}") from error
    tables = [_Table(found.pop(key, {}), key, known, name) for key, known in ENTRIES.items()]
    if found:
        raise InvalidOption(
            f"{name}: [{clean_text(min(found))[:40]}] is not known; give [panel], [lenses] and [viewer]"
        )
    return tables


def _check_lengths(display: IntegralDisplay, name: str) -> None:
    """Raises `InvalidOption` for lengths that don't fit one another, of which one is probably in another unit."""
    if display.lens_pitch < 2 * display.pixel_pitch:
        raise InvalidOption(
            f"{name}: a lens of {display.lens_pitch:g} mm over pixels of {display.pixel_pitch:g} mm; a lens covers at "
            "least 2 pixels; check the units (millimetres)"
        )
    if display.lens_pitch > (1 + ROUNDING) * min(display.size):
        panel_size = "{:g}x{:g}".format(*display.size)
        raise InvalidOption(
            f"{name}: a lens of {display.lens_pitch:g} mm is larger than the panel of {panel_size} mm; check the units "
            "(millimetres)"
        )
    if not ANGLES[0] <= display.angle <= ANGLES[1]:
        raise InvalidOption(
            f"{name}: a lens of {display.lens_pitch:g} mm with a gap of {display.gap:g} mm shows {display.angle:.3g} "
            f"degrees; lenses show {ANGLES[0]:g} to {ANGLES[1]:g}; check the units (millimetres)"
        )
    if display.distance < display.gap:
        raise InvalidOption(
            f"{name}: viewer.distance is {display.distance:g} mm, less than the gap of {display.gap:g} mm; give it "
            "from the lenses to the viewer, in millimetres"
        )


class _Table:
    """A table of the file. Raises `InvalidOption` if it has an entry that is not `known`."""

    def __init__(self, entries: Any, title: str, known: tuple[str, ...], name: str) -> None:
        if not isinstance(entries, dict):
            raise InvalidOption(f"{name}: {title} is not a table; write [{title}] on a line of its own")
        unknown = sorted(set(entries) - set(known))
        if unknown:
            raise InvalidOption(f"{name}: {title}.{clean_text(unknown[0])[:40]} is not known; give {', '.join(known)}")
        self._entries, self._title, self._name = entries, title, name

    def has(self, key: str) -> bool:
        return key in self._entries

    def number(self, key: str, low: float, high: float, default: float | None = None) -> float:
        if default is not None and key not in self._entries:
            return default
        value = self._entries.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise self._refuse(key, value, f"a number from {low:g} to {high:g}")
        return float(value)

    def pair(
        self, key: str, low: float, high: float, default: tuple[float, float] | None = None
    ) -> tuple[float, float]:
        value = self._entries.get(key, default)
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise self._refuse(key, value, "two numbers, as in [3840, 2160]")
        for one in value:
            if isinstance(one, bool) or not isinstance(one, int | float) or not low <= one <= high:
                raise self._refuse(key, one, f"numbers from {low:g} to {high:g}")
        return value[0], value[1]

    def word(self, key: str, default: str, known: tuple[Any, ...]) -> Any:
        value = self._entries.get(key, default)
        if value not in known:
            raise self._refuse(key, value, " or ".join(f'"{word}"' for word in known))
        return value

    def _refuse(self, key: str, value: object, remedy: str) -> InvalidOption:
        what = "missing" if value is None else f"{clean_text(str(value))[:40]!r}"
        return InvalidOption(f"{self._name}: {self._title}.{key} is {what}; give {remedy}")
