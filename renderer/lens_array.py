"""The lens array: positions of the lenses and directions of their pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_LENSES = 1 << 20
"""Most lenses along one side; limits on pictures usually allow fewer."""
MAX_PIXELS = 1 << 16
"""Most pixels along one side of an elemental image."""
TANGENT_RANGE = 0.4
"""Default full range of tangents over an elemental image: a viewing angle of 22.6 degrees."""


def compute_delta(parallax: float, pixels_v: int, pixels_u: int) -> float:
    """Returns the tangent between neighbouring pixels if an elemental image's larger side sees `parallax` degrees."""
    return 2 * float(np.tan(np.radians(parallax / 2))) / max(pixels_v, pixels_u)


@dataclass(frozen=True)
class LensArray:
    """`rows x cols` lenses in the plane z = 0 that look along -z, with `pixels_v x pixels_u` pixels under each.

    The coordinates are right-handed, y up. Lens (y, x), y from the top row and x from the left column, stands at
    `X = (x - (cols-1)/2) * pitch`, `Y = ((rows-1)/2 - y) * pitch`. Pixel (v, u) sees the direction `(tx, ty, -1)` with
    `tx = (u - (pixels_u-1)/2) * delta`, `ty = ((pixels_v-1)/2 - v) * delta`.

    Raises `InvalidOption` if a count or a length is out of range.
    """

    rows: int
    cols: int
    pixels_v: int
    pixels_u: int
    pitch: float = 1.0
    """Distance between neighbouring lenses, in scene units."""
    delta: float = 0.0
    """Tangent between neighbouring pixels, pixel size / gap; 0 means `TANGENT_RANGE / max(pixels_v, pixels_u)`."""

    def __post_init__(self) -> None:
        for name, value, most in (
            ("lenses", self.rows, MAX_LENSES),
            ("lenses", self.cols, MAX_LENSES),
            ("pixels", self.pixels_v, MAX_PIXELS),
            ("pixels", self.pixels_u, MAX_PIXELS),
        ):
            if not isinstance(value, Integral) or not 1 <= value <= most:
                raise InvalidOption(f"{name}: {value} is out of range; give 1 to {most} along each side")
        if self.delta == 0.0:
            object.__setattr__(self, "delta", TANGENT_RANGE / max(self.pixels_v, self.pixels_u))
        for name, length in (("pitch", self.pitch), ("delta", self.delta)):
            if not isinstance(length, Real) or not 1e-9 <= length <= 1e9:
                raise InvalidOption(f"{name}: {length} is out of range; give a positive number from 1e-9 to 1e9")

    @property
    def width(self) -> float:
        """Full width in scene units, one pitch for each column."""
        return self.cols * self.pitch

    @property
    def height(self) -> float:
        """Full height in scene units, one pitch for each row."""
        return self.rows * self.pitch

    def lens_x(self) -> NDArray[np.float64]:
        """Returns X of each column of lenses, `(cols,)`, in scene units."""
        return (np.arange(self.cols, dtype=np.float64) - (self.cols - 1) / 2) * self.pitch

    def lens_y(self) -> NDArray[np.float64]:
        """Returns Y of each row of lenses from the top down, `(rows,)`, in scene units."""
        return ((self.rows - 1) / 2 - np.arange(self.rows, dtype=np.float64)) * self.pitch

    def tangent_x(self) -> NDArray[np.float64]:
        """Returns tx of each pixel column u, `(pixels_u,)`."""
        return (np.arange(self.pixels_u, dtype=np.float64) - (self.pixels_u - 1) / 2) * self.delta

    def tangent_y(self) -> NDArray[np.float64]:
        """Returns ty of each pixel row v from the top down, `(pixels_v,)`."""
        return ((self.pixels_v - 1) / 2 - np.arange(self.pixels_v, dtype=np.float64)) * self.delta

    def refine(self, scale: int) -> LensArray:
        """Returns the array of the same extent with `pitch / scale`, whose views upscaling by `scale` estimates.

        Raises `InvalidOption` if `scale` is below 1 or there would be too many lenses.
        """
        if scale < 1:
            raise InvalidOption(f"scale: {scale} is out of range; give 1 or more")
        return replace(self, rows=self.rows * scale, cols=self.cols * scale, pitch=self.pitch / scale)
