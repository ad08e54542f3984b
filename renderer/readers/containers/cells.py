"""Light fields in MATLAB cell arrays: `views{v, u}` is view (v, u), each a picture of the same size and class."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.readers.containers.axes import settle_grid
from ciir.renderer.readers.containers.samples import (
    LOGICAL,
    check_array,
    has_axes_of_picture,
    is_type_read,
    show_shape,
)
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout

NO_SAMPLES = np.dtype("V1")
"""The type that stands for samples that are not read."""
_NUMBERS = (LOGICAL, "single", "double", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
_MOST_CELLS = 2500
"""The most cells of a file that are looked at, such as 50x50: HDF5 takes about 1 ms to read each."""


@dataclass(frozen=True)
class Cell:
    """The contents of a cell, as its header describes them."""

    kind: str = ""
    """MATLAB's class; empty if the cell holds no array, or one that lies elsewhere."""
    shape: tuple[int, ...] = ()
    """The axes in MATLAB's order."""
    dtype: np.dtype[Any] = NO_SAMPLES
    """The type of the samples."""

    @property
    def is_picture(self) -> bool:
        """Whether the cell has the class, axes and size of a view; the class may be one that is not read."""
        return self.kind in _NUMBERS and has_axes_of_picture(self.shape)

    @property
    def is_read(self) -> bool:
        """Whether the samples have a type that is read."""
        return self.kind != LOGICAL and is_type_read(self.dtype)

    def __str__(self) -> str:
        if not self.kind:
            return "not an array of its own"
        return f"{show_shape(self.shape)} {clean_text(self.kind[:20])}" if math.prod(self.shape) else "empty"


@dataclass(frozen=True)
class CellArray:
    """A cell array of a file."""

    shape: tuple[int, ...]
    cells: Iterable[Cell]
    """The cells, the first axis fastest. They are listed once, and only as far as they are looked at."""

    @property
    def may_hold_views(self) -> bool:
        """Whether the array has rows and columns, more than one cell, and a picture in the first cell."""
        is_grid = len(self.shape) == 2 and min(self.shape) >= 1 and math.prod(self.shape) > 1
        return is_grid and next(iter(self.cells), Cell()).is_picture

    def compare_cells(self, name: str, most: int) -> tuple[Cell, int, str]:
        """Returns the first cell, the number of cells from the start that are pictures like it, and the reason why the
        next one isn't.

        The reason is empty if all cells are. `name` is the array's, for messages. If there are more than `most` cells,
        only the first one is looked at.
        """
        count, number, first = math.prod(self.shape), 0, Cell()
        if min(self.shape) < 1:
            return first, 0, f"{name} has no cells"
        if count == 1:
            return first, 0, f"{name} has only one cell, and an elemental image array must be an array outside cells"
        if count > most:
            first = next(iter(self.cells), Cell())
            return first, 0, f"{name} has {count:,} cells, and at most {_MOST_CELLS:,} of a file are looked at"
        for number, cell in enumerate(self.cells, 1):
            first = cell if number == 1 else first
            if not cell.is_picture or cell != first:
                column, row = divmod(number - 1, self.shape[0])
                other = f"but {name}{{1,1}} is {first}" if cell.is_picture else "not a picture"
                return first, number - 1, f"{name}{{{row + 1},{column + 1}}} is {cell}, {other}"
        return first, number, "" if number == count else f"cells of {name} are cut off, or references to them packed"


@dataclass(frozen=True)
class Views:
    """A cell array that holds views."""

    grid: tuple[int, ...]
    cell: Cell
    """The header that all cells share."""

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape `(V, U, H, W, C)`."""
        return (*self.grid, *self.cell.shape[:2], math.prod(self.cell.shape[2:]))

    def read(
        self, cells: Iterator[NDArray[Any]], *, name: str, layout: Layout, limits: Limits
    ) -> tuple[NDArray[Any], tuple[str, ...]]:
        """Reads the samples of `cells`, the first axis fastest, as `(V, U, H, W, C)`.

        A single row or column of cells becomes the grid that `settle_grid` finds, with its notes. Raises like
        `check_array`, before any cell is read.
        """
        grid, notes = self.grid, tuple[str, ...]()
        if 1 in grid:
            grid, notes = settle_grid(math.prod(grid), layout, name, "cells")
        shape = (*grid, *self.shape[2:])
        check_array(name, shape, self.cell.dtype, limits)
        views = np.empty(self.shape, self.cell.dtype)
        for (u, v), samples in zip(np.ndindex(self.grid[::-1]), cells, strict=True):
            views[v, u] = samples.reshape(views.shape[2:])
        return views.reshape(shape), notes


def find_views(arrays: Mapping[str, CellArray]) -> tuple[dict[str, Views], str]:
    """Returns the cell arrays of a file that hold views, and the reason why another one doesn't, for messages.

    The reason is that of the array which comes closest. If some arrays have samples of a type that is read, only these
    are returned. `LF` is looked at first. If any are found, arrays that begin with a picture and have more cells than
    are looked at are returned too, so that none is selected by chance.
    """
    found: dict[str, Views] = {}
    unknown: dict[str, Views] = {}
    reasons: list[tuple[int, str]] = []
    left = _MOST_CELLS
    for key, array in sorted(arrays.items(), key=lambda item: item[0] != "LF"):
        if len(array.shape) == 2:
            first, number, reason = array.compare_cells(clean_text(key), left)
            left -= number
            if reason:
                reasons.append((number, reason))
                unknown |= {key: Views(array.shape, first)} if first.is_picture and not number else {}
            else:
                found[key] = Views(array.shape, first)
    _, reason = max(reasons, key=lambda known: known[0], default=(0, ""))
    found = {key: views for key, views in found.items() if views.cell.is_read} or found
    return found and found | unknown, reason
