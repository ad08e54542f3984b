"""Estimates the disparity of every pixel of a view, with its confidence.

A plane sweep compares the view with others around it at each of a set of disparities. Semi-global matching
(Hirschmueller, PAMI 30, 2008) makes a pixel agree with its neighbours, less so across edges, and the best three planes
give the fraction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, floor
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from ciir.bit_depth import count_unused_bits, raise_levels
from ciir.errors import InvalidOption, TooLarge
from ciir.renderer.focus.all_in_focus import focus_everywhere
from ciir.renderer.focus.stereo.matching import match
from ciir.renderer.focus.stereo.noise import estimate_noise, measure_blur
from ciir.renderer.focus.stereo.notes import find_mismatched, note_mismatched, note_reach
from ciir.renderer.focus.stereo.refinement import CLEAN, FIRST, LAST, refine, select_views
from ciir.renderer.focus.stereo.search_range import LEAST_SIDE, find_limits
from ciir.renderer.focus.stereo.sweep import Sweep, read_levels
from ciir.renderer.views import center_view, parse_views

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from os import PathLike

    from numpy.typing import NDArray

    from ciir.renderer.light_field import LightField
    from ciir.renderer.views import DepthSense, View

STEP = 1.0
"""Pixels by which the outermost compared view moves from one plane to the next."""
LEAST_PARTS = 4
"""Fewest planes per pixel of disparity."""
LEAST_PLANES, MOST_PLANES = 3, 96
MOST_COSTS = 2**27
"""Most pixels times planes: each takes 12 bytes."""
UNNOTICED = 2.5
"""8-bit levels of noise up to which pictures count as clean: fine texture looks like that much noise."""
OUTLINE = 13
"""Pixels along each side of the window around an outline within which it may be moved."""
CLEAN_VIEWS = 5
"""Rows, and columns, of views that correct a map of clean ones: 9 take three times as long for no fewer bad pixels."""
MOST_AT_LIMITS = 0.2
"""Largest share of pixels at a given limit without a note: a plain background may lie there."""
MOVED = 0.3
"""Pixels per view by which the sides of an outline differ."""


@dataclass(frozen=True, eq=False, repr=False)
class DisparityMap:
    """The disparity of each pixel of a view."""

    view: View
    disparity: NDArray[np.float32]
    """`(H, W)`: by how many pixels a point moves to the left from one view to the next on the right.

    With the depth sense `cameras` larger is nearer, as in the HCI benchmark; with `lenses` larger is farther."""
    confidence: NDArray[np.float32]
    """`(H, W)`, 0 to 1: how much better the best plane fits than the usual one; 0 if there is nothing to compare."""
    planes: NDArray[np.float64]
    """`(n,)`: the disparities that were compared; the fit goes between them."""
    depth_sense: DepthSense
    """Depth sense of the light field."""
    notes: tuple[str, ...] = ()
    """Notes that say where the search for a range of disparities ended, and whether nothing fits much of the view, or
    much of it lies at given limits."""

    @property
    def hci(self) -> NDArray[np.float32]:
        """The disparity in the sense of the HCI benchmark, larger is nearer: as with the depth sense `cameras`."""
        return self.disparity if self.depth_sense == "cameras" else -self.disparity

    def __repr__(self) -> str:
        rows, cols = self.disparity.shape
        least, most = self.disparity.min(), self.disparity.max()
        counted = f", {len(self.notes)} note{'s' * (len(self.notes) > 1)}" if self.notes else ""
        return (
            f"DisparityMap(view {self.view[0]},{self.view[1]}, {rows}x{cols} pixels, disparity {least:.3f} to "
            f"{most:.3f}, depth sense {self.depth_sense}{counted})"
        )

    def save(self, path: str | PathLike[str], /, format: str | None = None) -> dict[str, Any]:  # noqa: A002
        """Writes the map, and the confidence next to it, as `ciir.renderer.writers.depth.write_disparity` does."""
        from ciir.renderer.writers.atomic_write import read_path
        from ciir.renderer.writers.depth import write_disparity

        return write_disparity(read_path(path), self, format)


def estimate_disparity(
    light_field: LightField,
    view: View | None = None,
    *,
    limits: tuple[float, float] | None = None,
    beyond: float = 0.0,
    extra: Callable[[float], NDArray[np.float32]] | None = None,
    clips: bool = True,
    order: int = 3,
) -> DisparityMap:
    """Estimates the disparity of `view`, by default the centre one.

    `limits`: the smallest and the largest disparity in pixels per view, by default from `find_limits`. `beyond`: how
    far the same steps go on past the largest, as a share of the range, as long as `MOST_COSTS` allows. `extra`: what a
    disparity costs each pixel in addition to the comparison of views, `(H, W)` in 8-bit levels. `clips`: whether the
    map lies within `limits`, which the planes may exceed by a step. `order`: as in `stereo.refinement.refine`, for
    clean views.

    Other views then correct the map (`stereo.refinement`), in the case of clean views by less than a plane. If the
    noise is beyond `UNNOTICED`, all views correct it and make the view itself almost free of noise. Outlines are then
    searched again in that view, which takes ten times as long or more.

    Raises `InvalidOption` for a single view, for views of less than `LEAST_SIDE` pixels along a side, for a view that
    does not exist, and for limits that are not in order or exceed the longer side of a view; `TooLarge` for more than
    `MOST_COSTS` pixels times disparities.
    """
    found = _estimate(_raise_levels(light_field), view, limits, beyond=beyond, extra=extra, order=order)
    return _clip(found, limits) if clips and limits is not None else found


def _estimate(
    light_field: LightField,
    view: View | None,
    limits: tuple[float, float] | None,
    *,
    beyond: float = 0.0,
    extra: Callable[[float], NDArray[np.float32]] | None = None,
    order: int = 3,
) -> DisparityMap:
    """Does the same as `estimate_disparity` for views that use all bits."""
    views = light_field.views
    check_views(views)
    view = center_view(*views.shape[:2]) if view is None else _read_view(view)
    light_field.view(*view)
    farthest = max(views.shape[:2]) // 2
    parts = max(LEAST_PARTS, round(farthest / STEP))
    notes: list[str] = []
    if limits is None:
        limits = find_limits(views)
        notes += note_reach(limits, views.shape[2:4])
    else:
        _check_limits(limits, max(views.shape[2:4]))
    numbers = _list_planes(limits, parts, views.shape[2:4], beyond)
    deviation = estimate_noise(read_levels(views[view]).transpose(1, 2, 0))
    noise = max(0.0, deviation - UNNOTICED)
    planes = np.array(numbers) / parts
    mismatched: list[NDArray[np.bool_]] = []

    def look(own: NDArray[np.float32] | None = None) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns the map and its confidence; `own`: the view without noise."""
        blur, compared = min(noise / 11, 1.0), 4 if noise else 2
        sweep = Sweep(views, view, parts=parts, farthest=farthest, compared=compared, blur=blur, own=own)
        cost = sweep.compare(numbers)
        mismatched.append(find_mismatched(cost, sweep.most_cost, measure_blur(blur) * deviation if noise else 0.0))
        window = 3
        if own is None:
            cost /= 1 + noise / 5  # so that neighbours count more
            window = 2 * int(np.clip(round(noise / 4), 1, 4)) + 1
        if extra is not None:
            for index, plane in enumerate(planes):
                cost[index] += extra(float(plane))
        disparity, confidence = match(cost, sweep.own, planes)
        return ndimage.median_filter(disparity, window, mode="nearest"), confidence

    disparity, confidence = look()
    if noise:
        disparity = refine(views, view, disparity, deviation, FIRST)
        found = DisparityMap(view, disparity, confidence, planes, light_field.depth_sense)
        own = _focus(views, found)
        sharper, confidence = look(own)
        disparity = np.where(_find_moved(disparity, sharper), sharper, disparity)
        disparity = refine(views, view, disparity, deviation, LAST, own=own).clip(planes[0], planes[-1])
    else:
        corrected = refine(views, view, disparity, UNNOTICED, CLEAN, most=CLEAN_VIEWS, order=order)
        corrected = corrected.clip(planes[0], planes[-1])
        disparity = np.where(np.abs(corrected - disparity) < planes[1] - planes[0], corrected, disparity)
    notes += note_mismatched(mismatched[0], planes)
    disparity = disparity.astype(np.float32)
    return DisparityMap(view, disparity, confidence, planes, light_field.depth_sense, tuple(notes))


def _find_moved(disparity: NDArray[np.float32], sharper: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Returns the pixels, `(H, W)`, between the outlines of two maps: those that differ, starting from an outline of
    `disparity`.
    """

    def find_steps(side: int) -> NDArray[np.bool_]:
        steps = ndimage.maximum_filter(disparity, side) - ndimage.minimum_filter(disparity, side)
        return steps > MOVED  # type: ignore[no-any-return]

    differs = (np.abs(sharper - disparity) > MOVED) & find_steps(OUTLINE)
    starts = ndimage.binary_dilation(differs & find_steps(3))
    return ndimage.binary_propagation(starts, mask=differs)  # type: ignore[no-any-return]


def _focus(views: NDArray[Any], found: DisparityMap) -> NDArray[np.float32]:
    """Returns the view of `found` with less noise, `(C, H, W)` in 8-bit levels."""
    weights = np.zeros(views.shape[:2], np.float32)
    weights[np.ix_(*select_views(views.shape[:2], found.view))] = 1
    levels: NDArray[np.float32] = read_levels(focus_everywhere(views, found, weights))
    return levels * np.float32(255 / np.iinfo(views.dtype).max)


def estimate_disparities(
    light_field: LightField, views: Sequence[View] | None = None, *, limits: tuple[float, float] | None = None
) -> Iterator[DisparityMap]:
    """Yields the disparity of each of `views`, by default of all, row by row, one at a time as they are made.

    `limits`: as in `estimate_disparity`. Raises the same errors.
    """
    light_field = _raise_levels(light_field)
    notes: list[str] = []
    searched = limits
    if searched is None:
        check_views(light_field.views)
        searched = find_limits(light_field.views)
        notes += note_reach(searched, light_field.views.shape[2:4])
    for view in parse_views("all", *light_field.views.shape[:2]) if views is None else views:
        found = _estimate(light_field, view, searched)
        found = _clip(found, limits) if limits is not None else found
        yield replace(found, notes=(*notes, *found.notes))


def _clip(found: DisparityMap, limits: tuple[float, float]) -> DisparityMap:
    """Returns the map within `limits`, which the planes may exceed, with a note if much of it lies at one of them."""
    low, high = limits
    disparity = found.disparity.clip(low, high)
    share = float(((found.disparity <= low) | (found.disparity >= high)).mean())
    note = (
        f"limits: {100 * share:.0f} % of the pixels lie at {low:g} or {high:g}, the ends of the given range; give "
        "wider limits if there are other disparities"
    )
    return replace(found, disparity=disparity, notes=(*found.notes, *[note] * (share > MOST_AT_LIMITS)))


def _raise_levels(light_field: LightField) -> LightField:
    """Returns the light field with levels that use all bits if they have 16."""
    unused = count_unused_bits(light_field.views)
    return replace(light_field, views=raise_levels(light_field.views, unused)) if unused else light_field


def check_views(views: NDArray[Any]) -> None:
    """Raises `InvalidOption` for a single view and for views that are too small, `TooLarge` for those that are too
    large for the fewest disparities.
    """
    height, width = views.shape[2:4]
    if views.shape[0] * views.shape[1] < 2:
        raise InvalidOption("one view shows no depth; give a light field with two views or more")
    if min(height, width) < LEAST_SIDE:
        raise InvalidOption(f"views of {height}x{width} pixels show no depth; give {LEAST_SIDE}x{LEAST_SIDE} or more")
    if height * width * LEAST_PLANES > MOST_COSTS:
        raise TooLarge(
            f"views of {height}x{width} pixels are too large; give {MOST_COSTS // LEAST_PLANES:,} pixels or fewer"
        )


def _read_view(view: Any) -> View:
    if not _is_pair(view):
        raise InvalidOption(f"view: {view!r} is not a view; give its row and column, such as (4, 4)")
    return view[0], view[1]


def _is_pair(value: Any) -> bool:
    """Returns whether `value` is a pair of numbers; True and False are not numbers here."""
    if not isinstance(value, tuple | list | np.ndarray) or len(value) != 2:
        return False
    return all(isinstance(each, Real) and not isinstance(each, bool) for each in value)


def _check_limits(limits: Any, side: int) -> None:
    if not _is_pair(limits):
        raise InvalidOption(f"limits: {limits!r} is not a range; give two numbers, such as (-1.5, 2)")
    if not limits[0] < limits[1]:
        raise InvalidOption(f"limits: {limits[0]:g} to {limits[1]:g} is not a range; give the smaller disparity first")
    if max(-limits[0], limits[1]) > side:
        raise InvalidOption(
            f"limits: {limits[0]:g} to {limits[1]:g} exceeds the {side} pixels of a view; give disparities of -{side} "
            f"to {side}"
        )


def _list_planes(limits: tuple[float, float], parts: int, size: tuple[int, ...], beyond: float) -> range:
    """Returns the planes from one limit to the other, in parts of a pixel: `LEAST_PLANES` to about `MOST_PLANES`, and
    then those `beyond`.

    Raises `TooLarge` for more than `MOST_COSTS` pixels, in a view of `size`, times planes.
    """
    low, high = floor(round(limits[0] * parts, 9)), ceil(round(limits[1] * parts, 9))  # also for 1/49 * 49
    step = ceil((high - low) / MOST_PLANES)
    planes = range(low, max(high, low + LEAST_PLANES - 1) + step, step)
    height, width = size
    if height * width * len(planes) > MOST_COSTS:
        raise TooLarge(
            f"disparity: {height}x{width} pixels at {len(planes)} disparities are more than {MOST_COSTS} together, "
            "which take 2 GB; give limits that are closer to each other, or smaller views"
        )
    more = min(ceil(beyond * (len(planes) - 1)), MOST_COSTS // (height * width) - len(planes))
    return range(low, planes.stop + more * step, step)
