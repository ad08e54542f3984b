"""Calibrates a raw lenslet picture: finds its lens grid from the picture alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, get_args

import numpy as np

from ciir.errors import InvalidOption, Unreadable
from ciir.renderer.readers.lenslet.grid import Known, LensGrid, Shape
from ciir.renderer.readers.lenslet.refinement import Lenses, center_grid, measure_depth, refine_grid
from ciir.renderer.readers.lenslet.search import search_grid
from ciir.renderer.readers.lenslet.signals import (
    Cue,
    blur_lenses,
    find_even_parts,
    scale_luma,
    show_lenses,
    show_periods,
)
from ciir.renderer.readers.lenslet.spectrum import LEAST_LENSES, Estimate, estimate_grids

if TYPE_CHECKING:
    from numpy.typing import NDArray


_LEAST_CONTRAST = {"borders": 3.0, "edges": 4.0}  # photographs and noise reach 2.3
_DISTINCT = 0.8
_DARKER = 0.05  # fall of the logarithm of brightness from middle to border; less comes from the scene
_CLEARLY_DARKER = 0.12  # elemental image arrays without darker borders reach 0.09, borders of 0.8 of the light 0.13
_LOOK = 320, 1024  # pixels along a side, least and most
_MOST_TURNED = 15.0  # degrees: half way from rows to columns
_MOST_SCATTER = {"borders": 0.04, "edges": 0.03}  # pitches


class NoGrid(Unreadable):
    """The picture shows no lens grid at all."""


@dataclass(frozen=True)
class Calibration:
    """A lens grid, and the evidence for it."""

    grid: LensGrid
    """Its offset is that of the lens nearest to the picture's upper left corner."""
    cue: Cue | None = None
    """The cue that showed the grid; None if everything was given."""
    share: float = 0.0
    """The share of the picture's lenses that counted."""
    scatter: float = 0.0
    """Median distance of the lenses' own positions from the grid's, in pixels."""
    uncertainty: float = 0.0
    """Standard error of the pitch, in pixels, times the lenses along the picture's longer side."""
    in_columns: bool = False
    """Whether the grid is that of the transposed picture, because every other column of lenses is shifted."""

    @property
    def known(self) -> Known:
        """The grid in the picture's own rows and columns."""
        pitch, (y, x), rotation, shape = self.grid.pitch, self.grid.offset, self.grid.rotation, self.grid.shape
        if self.in_columns:
            return Known(pitch, (x, y), -rotation, "hexagonal-columns", 1 / self.grid.stretch)
        return Known(pitch, (y, x), rotation, shape, self.grid.stretch)


def calibrate(
    picture: NDArray[np.uint8] | NDArray[np.uint16],
    known: Known = Known(),  # noqa: B008 - it is frozen
    *,
    name: str = "picture",
    is_white: bool = False,
) -> Calibration:
    """Finds the lens grid of a raw lenslet picture, or of a white one, `(H, W, C)`.

    A first estimate comes from the Fourier transform, as in Dansereau, Pizarro and Williams, "Decoding, calibration and
    rectification for lenselet-based plenoptic cameras" (CVPR 2013). Phases in blocks refine it, then least squares over
    lenses. A square grid looks the same every 90 degrees of rotation, a hexagonal one every 60: the smallest rotation
    is found, with rows or with columns.

    Raises `Unreadable` if the picture shows no grid, or more than one. `name` and `is_white` are for messages.
    """
    found = _find_grid(picture, known, name, is_white=is_white)
    if found is not None:
        return found
    given = "" if known.pitch is None else f" of {known.pitch:g} pixels' pitch"
    other = None if known.pitch is None and known.shape is None else _find_other_grid(picture)
    if other is not None and known.shape not in (None, other.shape):
        raise Unreadable(
            f"{name}: shows no {known.shape} lens grid{given}, but a {other.shape} one of {other.pitch:.2f}; "
            f"give lens_grid {other.shape}, or leave it out"
        )
    if other is not None and known.pitch is not None:
        raise Unreadable(
            f"{name}: shows no lens grid{given}, but one of {other.pitch:.2f}; give lens_pitch {other.pitch:.2f}, "
            "or auto"
        )
    raise NoGrid(
        f"{name}: shows no lens grid{given} by itself: lenses must darken towards their borders, and each side must "
        f"have at least {LEAST_LENSES}; give {'' if is_white else 'a white picture, or '}lens_pitch, lens_offset, "
        "lens_rotation and lens_grid"
    )


def _find_grid(
    picture: NDArray[np.uint8] | NDArray[np.uint16], known: Known, name: str, *, is_white: bool = False
) -> Calibration | None:
    """Finds the grid for `calibrate`; returns None if the picture shows none."""
    if known.shape == "hexagonal-columns":
        found = _find_grid(picture.swapaxes(0, 1), known.transpose(), name, is_white=is_white)
        return None if found is None else replace(found, in_columns=True)
    if known.pitch is not None and known.offset is not None and known.rotation is not None and known.shape is not None:
        return Calibration(LensGrid(known.pitch, known.offset, known.rotation, known.shape, known.stretch))
    luma = scale_luma(picture)
    for cue in get_args(Cue):
        estimate = _estimate(luma, cue, known, name, is_white=is_white)
        if estimate is None:
            continue
        if estimate.shape == "hexagonal" and known.rotation is None and abs(estimate.rotation) > _MOST_TURNED:
            if known.shape is not None:  # not the one asked for, or neither in rows nor columns
                return None
            return _find_grid(picture, replace(known, shape="hexagonal-columns"), name, is_white=is_white)
        found = _refine(luma, cue, estimate, known)
        if found is None:
            continue
        return replace(found, grid=_move_to_corner(found.grid))
    return None


def _find_other_grid(picture: NDArray[np.uint8] | NDArray[np.uint16]) -> Known | None:
    """Finds the grid that the picture shows by itself."""
    try:
        found = _find_grid(picture, Known(), "")
    except (Unreadable, InvalidOption):
        return None
    return None if found is None else found.known


def detect_grid(picture: NDArray[np.uint8] | NDArray[np.uint16], about: int) -> LensGrid | None:
    """Finds the grid of lenses that clearly darken towards their borders, as those of a raw lenslet picture do; else
    None.

    This is a quick look, 0.05 s if there are none, at some 24 lenses of `about` pixels in the middle of the picture.
    """
    side = int(np.clip(24 * about, *_LOOK))
    top, left = (max(0, (length - side) // 2) for length in picture.shape[:2])
    luma = scale_luma(picture[top : top + side, left : left + side])
    try:
        estimate = _estimate(luma, "borders", Known(), "")
        found = None if estimate is None else _refine(luma, "borders", estimate, Known(), least_depth=_CLEARLY_DARKER)
    except (Unreadable, InvalidOption):  # two grids fit, or one whose lenses are too small
        return None
    if found is None:
        return None
    y, x = found.grid.offset
    return replace(found.grid, offset=(y + top, x + left))


def _estimate(
    luma: NDArray[np.float32], cue: Cue, known: Known, name: str, *, is_white: bool = False
) -> Estimate | None:
    shapes: tuple[Shape, ...] = get_args(Shape) if known.shape is None else (known.shape,)
    found = estimate_grids(show_periods(luma, cue), shapes, pitch=known.pitch, rotation=known.rotation)
    best = max(found.values(), default=None)
    if best is None or best.contrast < _LEAST_CONTRAST[cue]:
        return None
    for other in found.values():
        if other.shape != best.shape and other.contrast > _DISTINCT * best.contrast:
            raise Unreadable(
                f"{name}: a {best.shape} grid with a pitch of {best.pitch:.2f} pixels and a {other.shape} one with "
                f"{other.pitch:.2f} fit nearly as well; give lens_grid{'' if is_white else ', or a white picture'}"
            )
    return best


def _refine(
    luma: NDArray[np.float32], cue: Cue, estimate: Estimate, known: Known, *, least_depth: float = _DARKER
) -> Calibration | None:
    """Finds the exact grid; None if lenses don't agree with one, or don't darken by `least_depth` (see `_DARKER`)."""
    signal, blurred = show_lenses(luma, cue), blur_lenses(luma, estimate.pitch)
    keep_pitch, keep_rotation = known.pitch is not None, known.rotation is not None
    grid = search_grid(
        signal * find_even_parts(blurred, estimate.pitch),
        estimate,
        keep_pitch=keep_pitch,
        keep_rotation=keep_rotation,
    )
    grid = replace(grid, stretch=known.stretch)
    if known.offset is not None:
        grid = replace(grid, offset=known.offset)
    lenses = Lenses.find(grid, blurred)
    if len(lenses.i) < LEAST_LENSES:
        return None
    if known.offset is None:
        grid = center_grid(signal, lenses, grid)
    if cue == "borders" and measure_depth(luma, lenses, grid) <= least_depth:
        return None
    found = refine_grid(
        signal,
        blurred,
        lenses,
        grid,
        keep_pitch=keep_pitch,
        keep_offset=known.offset is not None or cue == "edges",  # content has more edges on one side of a border
        keep_rotation=keep_rotation,
    )
    if known.offset is None and cue == "edges":
        found = replace(found, grid=center_grid(signal, lenses, found.grid))
    agrees = found.scatter <= _MOST_SCATTER[cue] * found.grid.pitch
    return Calibration(found.grid, cue, found.share, found.scatter, found.uncertainty) if agrees else None


def _move_to_corner(grid: LensGrid) -> LensGrid:
    """Returns the same lenses, counted from the one inside the picture that is nearest to its upper left corner."""
    i, j = grid.find_nearest(np.zeros(2))
    around = np.mgrid[-2:3, -2:3].reshape(2, -1)
    centers = grid.find_centers(i + around[0], j + around[1])
    inside = centers[(centers >= 0).all(axis=1)]
    y, x = min(inside, key=lambda center: float(np.hypot(*center)))
    return replace(grid, offset=(float(y), float(x)))
