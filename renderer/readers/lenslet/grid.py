"""The lens grid of a raw lenslet picture: the positions of the lens centres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from numpy.typing import NDArray

Shape = Literal["square", "hexagonal"]
"""Rows and columns of lenses, or rows of which every other one is shifted by half a pitch."""
KnownShape = Literal["square", "hexagonal", "hexagonal-columns"]
"""A `Shape`, or columns of which every other one is shifted, which is a hexagonal grid of the transposed picture."""

ROW_STEP = {"square": 1.0, "hexagonal": 3**0.5 / 2}
"""Distance between neighbouring rows of a grid that isn't stretched, in pitches."""
LEAST_PITCH, MOST_PITCH = 5.0, 200.0
"""The least and the greatest pitch, in pixels."""


@dataclass(frozen=True)
class LensGrid:
    """Lens centres in a picture. Pixel centres lie at whole numbers, y down.

    Lens (0, 0) lies at `offset`. Lens (i, j) lies `i * row_step` pitches across the rows from there and j pitches along
    them, plus half a pitch if the grid is hexagonal and i is odd. Indices may be negative.

    Raises `InvalidOption` if the pitch is out of range.
    """

    pitch: float
    """Pixels between neighbouring lenses of a row."""
    offset: tuple[float, float]
    """(y, x) of one lens's centre, in pixels."""
    rotation: float = 0.0
    """In degrees; with a positive rotation, rows go down to the right."""
    shape: Shape = "square"
    stretch: float = 1.0
    """Distance between rows, divided by that of a regular grid."""

    def __post_init__(self) -> None:
        if not LEAST_PITCH <= self.pitch <= MOST_PITCH:
            raise InvalidOption(
                f"lens_pitch: {self.pitch:g} is out of range; give {LEAST_PITCH:g} to {MOST_PITCH:g} pixels"
            )

    @property
    def row_step(self) -> float:
        """Distance between neighbouring rows, in pitches."""
        return ROW_STEP[self.shape] * self.stretch

    @property
    def axes(self) -> NDArray[np.float64]:
        """Unit vectors across the rows and along them, `(2, 2)`, each as (y, x)."""
        return make_axes(self.rotation)

    def find_positions(self, row: NDArray[np.int64], along: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns (y, x) in pixels, `(..., 2)`, of points `along` pitches along each row, counted from lens (0, 0)."""
        steps = np.stack(np.broadcast_arrays(row * self.row_step, along), axis=-1)  # (..., 2)
        positions: NDArray[np.float64] = np.asarray(self.offset) + self.pitch * (steps @ self.axes)
        return positions

    def find_centers(self, i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.float64]:
        """Returns (y, x) of lenses (i, j) in pixels, `(..., 2)`."""
        return self.find_positions(i, j + self.find_shift(i))

    def find_shift(self, i: NDArray[np.int64]) -> NDArray[np.float64]:
        """Returns the number of pitches by which the lenses of rows i are shifted along them."""
        return (i % 2) / 2 if self.shape == "hexagonal" else np.zeros(np.shape(i))

    def find_nearest(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Returns the lenses (i, j) whose centres are nearest to the points (y, x) in pixels, `(..., 2)`."""
        across, along = np.moveaxis((points - np.asarray(self.offset)) @ self.axes.T / self.pitch, -1, 0)
        step = self.row_step
        first = np.floor(across / step).astype(np.int64)
        rows = np.stack([first, first + 1])  # the nearest lens is in one of the two rows around a point
        shift = self.find_shift(rows)
        lenses = np.rint(along - shift).astype(np.int64)
        squared = (across - rows * step) ** 2 + (along - lenses - shift) ** 2
        nearest = squared.argmin(axis=0)[None]
        return np.take_along_axis(rows, nearest, 0)[0], np.take_along_axis(lenses, nearest, 0)[0]


@dataclass(frozen=True)
class Known:
    """The known part of a raw lenslet picture's grid. Whatever is None is found from the picture."""

    pitch: float | None = None
    offset: tuple[float, float] | None = None
    rotation: float | None = None
    shape: KnownShape | None = None
    stretch: float = 1.0

    def transpose(self) -> Known:
        """Turns a grid of shape `hexagonal-columns` into a `hexagonal` one of the transposed picture."""
        offset = None if self.offset is None else (self.offset[1], self.offset[0])
        return Known(
            self.pitch, offset, None if self.rotation is None else -self.rotation, "hexagonal", 1 / self.stretch
        )


def make_axes(rotation: float) -> NDArray[np.float64]:
    """Returns unit vectors across the rows and along them, `(2, 2)`, each as (y, x), of a grid turned by `rotation`
    degrees.
    """
    cosine, sine = np.cos(np.deg2rad(rotation)), np.sin(np.deg2rad(rotation))
    return np.array([[cosine, -sine], [sine, cosine]])
