"""Matching: brings an upscaled view closer to the views around it, as they were seen.

Irani and Peleg, "Improving resolution by image registration" (CVGIP 53(3), 1991): a picture is moved to the place of
each view, downscaled as that view was, and compared with it, and the differences are moved back and added. Each round
is followed by Wiener's filter for the downscaling, so that few rounds are enough. What the views don't show stays as
it was: each round also goes back towards the first picture, most where there is little contrast.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models.back_projection import measure_contrast
from ciir.models.light_field.fusion.pixels import DEVIATION, enlarge
from ciir.models.light_field.fusion.warping import TAPS, weigh_taps
from ciir.models.parallel import run_each

if TYPE_CHECKING:
    from collections.abc import Mapping

    from scipy import sparse

    from ciir.models.back_projection import SamplingKind
    from ciir.models.light_field.disparities.shifts import Plane
    from ciir.models.light_field.windows import View

ROUNDS = 8
OWN_WEIGHT = np.float32(5)
"""Weight of the view itself; that of another one is at most 1. Its place is certain."""
WIENER = 0.2
"""Noise of Wiener's filter, as a share of a flat picture's power."""
PRIOR = 0.03
"""Share of the distance from the first picture that is undone in each round, at a contrast of 1; up to ten times as
much in flat parts."""
SOFT = np.float32(0.08**2)
"""Squared difference, in units of contrast, at which a pixel of another view counts half."""
PATCH, AROUND = 3, 9
"""Sides of that patch, and of the square over which views are brought to the same brightness, in pixels of a view."""
STRIP_PIXELS, FEWEST_ROWS, MARGIN = 20_000, 32, 12
"""Pixels of a view that are processed at once, as whole rows, to save memory; the fewest rows; and rows on each side
whose result is not used."""
EDGE = 16
"""Pixels by which a picture is continued for Wiener's filter."""


class Seen(NamedTuple):
    """A view as it was seen."""

    luma: Plane
    """`(H, W)`, in units of the matched view's contrast."""
    disparity: Plane
    """`(H, W)`, pixels from one view to the next."""


class _Link(NamedTuple):
    """How a picture and a view are related."""

    luma: Plane
    away: sparse.csr_array
    """From the filtered picture to the view."""
    back: sparse.csr_array
    """From the view to the picture."""
    weight: Plane
    is_own: bool


def match_views(
    picture: Plane,
    own: Seen,
    others: Mapping[View, Seen],
    sampling: SamplingKind,
    *,
    noise: float = 0.0,
    cores: int = 1,
) -> Plane:
    """Returns `picture` `(scale*H, scale*W)`, the luma of the upscaled view `own`, closer to it and to `others`, by
    offset (down, right).

    `sampling`: how the views were sampled. A difference d is weighted by d^2 / (d^2 + noise^2). A view that shows other
    content at a pixel hardly counts. All are in units of the view's contrast. `cores`: most strips that are matched at
    once.
    """
    scale = len(picture) // len(own.luma)
    height, width = own.luma.shape
    count = max(FEWEST_ROWS, STRIP_PIXELS // width)
    shifts = {offset: _find_shift(own, seen.luma, offset) for offset, seen in others.items()}
    result = np.empty_like(picture)

    def match_strip(top: int) -> None:
        bottom = min(top + count, height)
        first, last = max(0, top - MARGIN), min(bottom + MARGIN, height)
        strip = Seen(own.luma[first:last], own.disparity[first:last])
        links = [_link(strip, strip, (0, 0), np.zeros(2, np.float32), down=0, scale=scale)]
        for offset, seen in others.items():
            moves = strip.disparity * offset[0] + shifts[offset][0]
            start = min(max(0, first + math.floor(moves.min()) - 1), height - 1)
            part = slice(start, max(start + 1, last + math.ceil(moves.max()) + 1))
            near = Seen(seen.luma[part], seen.disparity[part])
            links.append(_link(strip, near, offset, shifts[offset], down=start - first, scale=scale))
        made = _solve(picture[scale * first : scale * last], links, _make_filter(sampling, scale), noise)
        result[scale * top : scale * bottom] = made[scale * (top - first) :][: scale * (bottom - top)]

    tops = range(0, height, count)
    run_each(match_strip, tops, min(cores, len(tops)))
    return result


def _find_shift(own: Seen, other: Plane, offset: View) -> Plane:
    """Returns by how many pixels `other` lies further down and right than its offset says: cameras are a little off.

    Two steps of least squares on the gradient (Lucas and Kanade, IJCAI 1981) over the whole view.
    """
    from scipy import ndimage  # imported here because most jobs don't need it

    shift = np.zeros(2, np.float32)
    if min(other.shape) < 2:
        return shift
    rows, cols = _list_places(other.shape)
    for _ in range(2):
        places = rows + own.disparity * offset[0] + shift[0], cols + own.disparity * offset[1] + shift[1]
        moved = ndimage.map_coordinates(other, places, order=1, mode="nearest")
        difference = own.luma - moved
        difference -= ndimage.uniform_filter(difference, AROUND, mode="nearest")
        slopes = np.stack([np.gradient(moved, axis=axis).ravel() for axis in (0, 1)])
        weighted = slopes * (0.09 / (0.09 + np.square(difference))).ravel()
        squares = weighted @ slopes.T + np.float32(1e-6 * moved.size) * np.eye(2, dtype=np.float32)
        shift += np.clip(np.linalg.solve(squares, weighted @ difference.ravel()), -0.5, 0.5)
    return shift


def _sample(other: Plane, disparity: Plane, offset: View, shift: Plane, down: int = 0) -> Plane:
    """Returns `other`, which begins `down` rows further down, at the content of each pixel of a view."""
    rows, cols = _list_places(disparity.shape)
    places = rows + disparity * offset[0] + shift[0] - down, cols + disparity * offset[1] + shift[1]
    result: Plane = (_make_matrix(*places, other.shape) @ other.ravel()).reshape(disparity.shape)
    return result


def _list_places(shape: tuple[int, ...]) -> tuple[Plane, Plane]:
    """Returns the numbers of the rows, `(H, 1)`, and of the columns, `(1, W)`."""
    return np.arange(shape[0], dtype=np.float32)[:, None], np.arange(shape[1], dtype=np.float32)[None]


def _link(own: Seen, seen: Seen, offset: View, shift: Plane, *, down: int, scale: int) -> _Link:
    """Relates the upscaled picture of `own` to the view `seen`, which begins `down` rows further down."""
    from scipy import ndimage

    full = (scale * own.luma.shape[0], scale * own.luma.shape[1])
    rows, cols = _list_places(seen.luma.shape)
    rows, cols = rows + down - seen.disparity * offset[0] - shift[0], cols - seen.disparity * offset[1] - shift[1]
    middle = (scale - 1) // 2  # the filtered picture lies half a pixel further down and right if the scale is even
    away = _make_matrix(scale * rows + middle, scale * cols + middle, full)
    rows, cols = ((place + 0.5) / np.float32(scale) - 0.5 for place in _list_places(full))
    moved = enlarge(own.disparity, scale)
    rows, cols = rows + moved * offset[0] + shift[0] - down, cols + moved * offset[1] + shift[1]
    back = _make_matrix(rows, cols, seen.luma.shape, is_linear=True)
    if offset == (0, 0):
        return _Link(seen.luma, away, back, np.full(full, OWN_WEIGHT), True)
    difference = own.luma - _sample(seen.luma, own.disparity, offset, shift, down)
    difference -= ndimage.uniform_filter(difference, AROUND, mode="nearest")
    power = np.maximum(ndimage.uniform_filter(np.square(difference), PATCH, mode="nearest"), 0)
    return _Link(seen.luma, away, back, enlarge(np.exp(power * np.float32(-1 / DEVIATION**2)), scale), False)


def _make_matrix(rows: Plane, cols: Plane, shape: tuple[int, ...], *, is_linear: bool = False) -> sparse.csr_array:
    """Returns the matrix that samples a picture of `shape` at places, by cubic convolution or linear interpolation;
    beyond the border the edge is repeated.
    """
    from scipy import sparse

    taps = (0, 1) if is_linear else TAPS
    lines = []
    for places, length in zip(np.broadcast_arrays(rows, cols), shape, strict=True):
        place = np.clip(places.ravel(), 0, length - 1).astype(np.float32)
        before = np.floor(place)
        share = place - before
        before = before.astype(np.int32)
        weights = [1 - share, share] if is_linear else weigh_taps(share)
        lines.append(([np.clip(before + tap, 0, length - 1) for tap in taps], weights))
    (tops, down), (lefts, across) = lines
    count = len(taps) ** 2
    numbers, values = (np.empty((len(down[0]), count), dtype) for dtype in (np.int32, np.float32))
    for number in range(count):
        row, col = divmod(number, len(taps))
        np.add(tops[row] * np.int32(shape[1]), lefts[col], out=numbers[:, number])
        np.multiply(down[row], across[col], out=values[:, number])
    starts = np.arange(len(values) + 1, dtype=np.int32) * np.int32(count)
    return sparse.csr_array((values.ravel(), numbers.ravel(), starts), shape=(len(values), shape[0] * shape[1]))


def _make_filter(sampling: SamplingKind, scale: int) -> Plane:
    """Returns the weights along one axis with which a pixel of a view was sampled."""
    if sampling == "means":
        return np.full(scale, 1 / scale, np.float32)
    count = 4 * scale - scale % 2
    places = np.abs(np.arange(count, dtype=np.float32) - np.float32((count - 1) / 2)) / np.float32(scale)
    weights: Plane = np.where(places < 1, weigh_taps(places)[1], weigh_taps(places - 1)[0])
    weights /= weights.sum()
    return weights


def _solve(first: Plane, links: list[_Link], weights: Plane, noise: float) -> Plane:
    """Returns the picture that fits all of `links`, beginning with `first`."""
    from scipy import ndimage

    total_weight = sum(link.weight for link in links)
    power = ndimage.uniform_filter(np.square(measure_contrast(first)), PATCH + 2, mode="nearest")
    contrast = np.sqrt(np.maximum(power, 0))  # the filter's sums can fall below zero by rounding
    prior = np.float32(PRIOR) * np.minimum(1 / (contrast + np.float32(0.1)), 10)
    sharpen = _Wiener(first.shape, weights)
    picture = first
    for _ in range(ROUNDS):
        filtered = picture
        for axis in (0, 1):
            filtered = ndimage.correlate1d(filtered, weights, axis, mode="nearest", origin=-(1 - len(weights) % 2))
        change = np.zeros_like(first)
        for link in links:
            difference = link.luma - (link.away @ filtered.ravel()).reshape(link.luma.shape)
            if not link.is_own:
                difference -= ndimage.uniform_filter(difference, AROUND, mode="nearest")
                difference *= SOFT / (SOFT + np.square(difference))
            if noise:
                power = np.square(difference)
                difference *= power / (power + np.float32(noise**2))
            change += link.weight * (link.back @ difference.ravel()).reshape(first.shape)
        change /= total_weight
        change -= prior * (picture - first)
        picture = picture + sharpen(change)
    return picture


class _Wiener:
    """Wiener's filter against a downscaling and its transpose."""

    def __init__(self, shape: tuple[int, ...], weights: Plane) -> None:
        """`weights`: those of the downscaling, along one axis."""
        from scipy import fft

        self._after = [fft.next_fast_len(side + 2 * EDGE, real=True) - side - EDGE for side in shape]
        rows, cols = (side + EDGE + after for side, after in zip(shape, self._after, strict=True))
        down, across = (
            np.square(np.abs(np.exp(-2j * np.pi * np.outer(places, range(len(weights)))) @ weights))
            for places in (fft.fftfreq(rows), fft.rfftfreq(cols))
        )
        self._gains = ((1 + WIENER) / (np.outer(down, across) + WIENER)).astype(np.float32)

    def __call__(self, picture: Plane) -> Plane:
        from scipy import fft

        padded = np.pad(picture, [(EDGE, after) for after in self._after], mode="symmetric")
        made = fft.irfft2(fft.rfft2(padded) * self._gains, s=padded.shape)
        result: Plane = made[EDGE : EDGE + picture.shape[0], EDGE : EDGE + picture.shape[1]]
        return result
