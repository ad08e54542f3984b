"""Interpolates views between others with a plane sweep between each pair of neighbours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.backends.progress import run_parts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels

REACH = 1 / 12
"""Largest disparity between neighbours that is searched, as a share of a view's side."""
MOST_STEPS = 40
"""Largest disparity that is searched, in pixels."""
WINDOW = 7
"""Side of the box over which a disparity is judged, in pixels."""
FEW = 0.004
"""Share of the pixels below which a disparity counts as an error."""
MANY, NEAR = 0.02, 4
"""The same share for a disparity more than `NEAR` pixels from the next one found."""
STRIP = 32
"""Rows that are interpolated at a time, few enough to fit into a processor's cache."""
REST = 0.1
"""Cost of a pixel of disparity, in levels of 255: where there is no texture, the smallest disparity wins."""


def interpolate_views(views: Pixels, count: int) -> Pixels:
    """Returns `count` views at equal steps from first to last of `views`, `(n, h, w, c)`, whose cameras stand in a
    row.

    Content moves along x from view to view. Between two views each pixel is the blend of the pair of pixels that agree
    best over a box, among all pairs that a disparity of up to `REACH` allows (a plane sweep, Collins 1996). Existing
    views are returned as they are.
    """
    total = len(views)
    if total == 1 or count == 1:
        return np.broadcast_to(views[(total - 1) // 2], (count, *views.shape[1:]))
    searched = choose_searched(views)
    result = np.empty((count, *views.shape[1:]), views.dtype)
    positions = np.linspace(0, total - 1, count)

    def make(index: int) -> None:
        result[index] = interpolate_view(views, positions[index], searched)

    run_parts(make, count)
    return result


def choose_searched(views: Pixels) -> range:
    """Returns the disparities to search between neighbours of `(n, h, w, c)`, whole pixels; only 0 if n is 1."""
    if len(views) == 1:
        return range(1)
    least, largest = find_disparities(views)
    return range(least - 1, largest + 2)


def interpolate_view(views: Pixels, position: float, searched: range) -> Pixels:
    """Returns the view at `position`, from 0 for the first of `views` `(n, h, w, c)` to n - 1, as `interpolate_views`
    does, `(h, w, c)`. `searched`: from `choose_searched`.
    """
    left = max(0, min(int(position + 1e-9), len(views) - 2))  # so that a rounding error does not miss an existing view
    fraction = position - left
    if min(fraction, 1 - fraction) < 1e-6:
        existing: Pixels = views[left + round(fraction)]
        return existing
    between = np.empty(views.shape[1:], views.dtype)
    between[...] = np.rint(_interpolate(views[left], views[left + 1], fraction, searched)[0])
    return between


def find_disparities(views: Pixels) -> tuple[int, int]:
    """Returns the smallest and the largest disparity, in whole pixels, between the two middle views of `(n, h, w, c)`.

    Disparities of few pixels are ignored (`FEW`, `MANY`). Larger is nearer (the HCI benchmark's sense).
    """
    middle = (len(views) - 1) // 2
    most = max(1, min(MOST_STEPS, round(REACH * views.shape[2])))
    _, found = _interpolate(views[middle], views[middle + 1], 0.5, range(-most, most + 1))
    width = found.shape[1]
    margin = most if width > 2 * most else 0  # there one view may not show what the other one does
    inside = found[:, margin : width - margin]
    counts = np.bincount((inside + most).ravel(), minlength=2 * most + 1)
    ends = []
    for side in (counts[::-1], counts):  # repeating patterns cause errors far from the true disparities
        last = int(side.argmax())
        for index in range(last + 1, len(side)):
            if side[index] > (FEW if index - last <= NEAR else MANY) * inside.size:
                last = index
        ends.append(last - most)
    return -ends[0], ends[1]


def _interpolate(
    left: Pixels, right: Pixels, fraction: float, disparities: range
) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Returns the view at `fraction` of the way from `left` to `right`, `(h, w, c)`, unrounded, and its disparities."""
    height = left.shape[0]
    result, found = np.empty(left.shape, np.float32), np.empty(left.shape[:2], np.intp)
    for top in range(0, height, STRIP):
        rows = np.arange(top - WINDOW // 2, min(top + STRIP, height) + WINDOW // 2).clip(0, height - 1)
        inside = slice(top, top + STRIP)
        result[inside], found[inside] = _interpolate_strip(left[rows], right[rows], fraction, disparities)
    return result, found


def _interpolate_strip(
    left: Pixels, right: Pixels, fraction: float, disparities: range
) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Does the same as `_interpolate` for rows with `WINDOW // 2` more above and below them."""
    margin = WINDOW // 2
    width = left.shape[1]
    reach = max(abs(disparities[0]), abs(disparities[-1])) + 1 + margin
    # Channels first and borders repeated: (c, rows + 2 margin, w + 2 reach).
    one, other = (
        np.pad(side.transpose(2, 0, 1).astype(np.float32), ((0, 0), (0, 0), (reach, reach)), "edge")
        for side in (left, right)
    )
    levels = np.iinfo(left.dtype).max / 255
    best = np.full((left.shape[0] - 2 * margin, width), np.inf, np.float32)
    chosen = np.zeros(best.shape, np.intp)
    costs = np.empty((left.shape[0], width + 2 * margin), np.float32)
    for index, disparity in enumerate(disparities):
        shifts = fraction * disparity, (fraction - 1) * disparity
        first, second = (_shift(side, shift, reach, width) for side, shift in zip((one, other), shifts, strict=True))
        np.divide(np.abs(first - second).sum(axis=0), np.float32(len(one)), out=costs[:, margin:-margin])
        costs[:, :margin], costs[:, -margin:] = costs[:, margin, None], costs[:, -margin - 1, None]  # np.pad is slower
        cost = _average_box(costs) + REST * levels * abs(disparity)
        is_better = cost < best
        np.copyto(best, cost, where=is_better)
        chosen[is_better] = index
    found = chosen + disparities[0]
    inner = slice(margin, margin + len(best))
    first, second = (
        _gather(side[:, inner], np.multiply(share, found, dtype=np.float64), reach)
        for side, share in ((one, fraction), (other, fraction - 1))
    )
    blend = first + fraction * (second - first)
    return blend.transpose(1, 2, 0), found


def _shift(padded: NDArray[np.float32], shift: float, reach: int, width: int) -> NDArray[np.float32]:
    """Does the same as `shift_rows` for `(c, rows, w + 2 reach)` whose borders are repeated."""
    low = int(np.floor(shift))
    weight = np.float32(shift - low)
    start = reach + low
    return padded[..., start : start + width] * (1 - weight) + padded[..., start + 1 : start + 1 + width] * weight


def _gather(padded: NDArray[np.float32], shift: NDArray[np.float64], reach: int) -> NDArray[np.float32]:
    """Does the same as `_shift` with a shift for each pixel, `(rows, w)`."""
    low = np.floor(shift).astype(np.intp)
    weight = (shift - low).astype(np.float32)
    rows = np.arange(shift.shape[0])[:, None]
    columns = np.arange(shift.shape[1]) + reach + low
    gathered: NDArray[np.float32] = padded[:, rows, columns] * (1 - weight) + padded[:, rows, columns + 1] * weight
    return gathered


def shift_rows(picture: NDArray[np.float32], shift: float) -> NDArray[np.float32]:
    """Returns the picture `(h, w, c)` with pixel x taken from `x + shift`, linearly, with the last pixel repeated."""
    position = np.clip(np.arange(picture.shape[1]) + shift, 0, picture.shape[1] - 1)
    low = position.astype(np.intp)
    high = np.minimum(low + 1, picture.shape[1] - 1)
    weight = (position - low).astype(np.float32)[:, None]
    shifted: NDArray[np.float32] = picture[:, low] * (1 - weight) + picture[:, high] * weight
    return shifted


def _average_box(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the means over all boxes of `WINDOW x WINDOW` values that lie inside `(h, w)`."""
    sums = values.astype(np.float64)
    for _ in range(2):
        twos = sums[:-1] + sums[1:]
        fours = twos[:-2] + twos[2:]
        sums = (fours[:-3] + twos[4:-1] + sums[6:]).T  # sums of `WINDOW` values
    means: NDArray[np.float32] = (sums / WINDOW**2).astype(np.float32)
    return means


def weigh_neighbours(
    position: NDArray[np.float64], count: int
) -> tuple[tuple[NDArray[np.intp], NDArray[np.float64]], tuple[NDArray[np.intp], NDArray[np.float64]]]:
    """Returns the two of `count` samples around each `position`, and their weights; beyond the border, the last one."""
    position = np.clip(position, 0, count - 1)
    low = np.minimum(position.astype(np.intp), max(count - 2, 0))
    weight = position - low
    return (low, 1 - weight), (np.minimum(low + 1, count - 1), weight)
