"""Measures how well each order of views explains tiles of the centre view and of the eight views around it.

In the right order, content at one depth moves by one disparity from each view to the next: as far down as across, and
diagonally by both. Disparities are swept or, if content moves by less than a pixel, fitted to slopes of brightness.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Plane = NDArray[np.float32]
    """Luma in [0, 1], or a quantity computed from it; the last axes are rows and columns."""

Order = Literal["as given", "reversed along one axis", "transposed", "transposed and reversed along one axis"]
ORDERS: tuple[Order, ...] = get_args(Order)
"""The order that rows (down) and columns (right) of views should have, compared with the order that they have:
`as given`, (down, right); `reversed along one axis`, (-down, right); `transposed`, (right, down); both, (-right,
down)."""
AROUND = tuple((down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if (down, right) != (0, 0))
"""The views around the centre view, as steps to them."""
_WAYS = (
    AROUND,
    tuple((-down, right) for down, right in AROUND),
    tuple((right, down) for down, right in AROUND),
    tuple((-right, down) for down, right in AROUND),
)
"""Where each of `AROUND` lies in each of `ORDERS`."""

TILE, REACH = 16, 6
"""Pixels along a side of a tile, and how far it is searched in each direction."""
SHIFTS = np.arange(-2 * REACH, 2 * REACH + 1) / 2
"""Shifts from one view to another that are tried, in pixels."""
LARGEST_SLOPE = 1.0
"""Largest shift that slopes are fitted for, in pixels: brightness is hardly ever linear over more."""
LEAST_EXPLAINED = 0.3
"""Smallest share of the squared change that some motion must explain. The rest is noise, and aliasing, which doesn't
move."""
_TINY = 1e-9


def sweep_disparities(correlation: Plane) -> Plane:
    """Returns the highest mean correlation with all neighbouring views that a disparity has in each of `ORDERS`,
    `(T, 4)`.

    `correlation`: from `correlate` with the views `AROUND`.
    """
    return np.stack([mean.max(axis=1) for mean in _average_lines(correlation, _WAYS)], axis=1)


def find_shifts(correlation: Plane) -> tuple[Plane, Plane]:
    """Returns by how many pixels each tile moves to the next of the views `AROUND`, in order, and the mean correlation
    there, `(T,)` each. `correlation`: as for `sweep_disparities`.
    """
    (mean,) = _average_lines(correlation, _WAYS[:1])
    return SHIFTS[mean.argmax(axis=1)].astype(np.float32), mean.max(axis=1)


def _average_lines(correlation: Plane, ways: Sequence[Sequence[tuple[int, int]]]) -> list[Plane]:
    """Returns the mean correlation with all neighbouring views at each of `SHIFTS`, `(T, shifts)`, for each of some
    `_WAYS`.
    """
    lines = {
        (0, 1): correlation[:, :, REACH] @ _WEIGHTS.T,
        (1, 0): correlation[:, :, :, REACH] @ _WEIGHTS.T,
        (1, 1): np.einsum("tnsj,sj->tns", _WEIGHTS @ correlation, _WEIGHTS),
        (1, -1): np.einsum("tnsj,sj->tns", _WEIGHTS @ correlation, _WEIGHTS[::-1]),
    }
    lines |= {(-down, -right): line[..., ::-1] for (down, right), line in lines.items()}
    return [np.mean([lines[way][:, number] for number, way in enumerate(each)], axis=0) for each in ways]


def fit_slopes(center: Plane, around: Plane) -> Plane:
    """Returns how much of the change from the centre view to all neighbouring views one disparity explains in each of
    `ORDERS`, `(T, 4)`, as a share of what any motion explains that is linear in the steps.

    It is fitted by least squares, as a shift changes brightness by its slope times the shift (Lucas and Kanade, IJCAI
    1981). The share is 0 if the disparity is over `LARGEST_SLOPE`, and in tiles where no motion explains
    `LEAST_EXPLAINED` of the change.

    `center`: tiles of the centre view `(T, TILE, TILE)`. `around`: the same places in the views `AROUND`, with `REACH`
    more pixels on each side, `(T, 8, TILE + 2*REACH, TILE + 2*REACH)`.
    """
    changes = _center((around[:, :, REACH:-REACH, REACH:-REACH] - center[:, None])[:, :, 1:-1, 1:-1])
    down = _center(center[:, 2:, 1:-1] - center[:, :-2, 1:-1]) / 2
    across = _center(center[:, 1:-1, 2:] - center[:, 1:-1, :-2]) / 2
    slopes = np.stack([down, across], axis=1)  # (T, 2, TILE - 2, TILE - 2)
    power = np.einsum("taij,tbij->tab", slopes, slopes) + np.float32(_TINY) * np.eye(2, dtype=np.float32)
    total = np.square(changes).sum(axis=(1, 2, 3)) + np.float32(_TINY)
    along = np.einsum("tnij,taij->tna", changes, slopes)
    # The steps down and across to all neighbouring views are independent, and have the same sum of squares.
    steps = np.array(AROUND, np.float32)
    squares = (steps[:, 0] ** 2).sum()
    products = np.einsum("tna,nb->tab", along, steps)
    any_motion = np.einsum("tab,tab->t", products, np.linalg.solve(power, products)) / squares
    explained = []
    for ways in _WAYS:
        product = np.einsum("tna,na->t", along, np.array(ways, np.float32))
        weight = squares * np.trace(power, axis1=1, axis2=2)
        is_small = np.abs(product) <= LARGEST_SLOPE * weight
        explained.append(is_small * product**2 / weight / np.maximum(any_motion, np.float32(_TINY)))
    shares: Plane = np.stack(explained, axis=1) * (any_motion >= LEAST_EXPLAINED * total)[:, None]
    return shares


def _center(values: Plane) -> Plane:
    """Returns `values` minus their mean over the last two axes."""
    centered: Plane = values - values.mean(axis=(-2, -1), keepdims=True)
    return centered


def correlate(tiles: Plane, around: Plane) -> Plane:
    """Returns the correlation of `tiles` `(T, TILE, TILE)` with `around` `(T, N, TILE + 2*REACH, TILE + 2*REACH)` at
    each whole shift, `(T, N, 2*REACH + 1, 2*REACH + 1)`.
    """
    size, count = around.shape[-1], 2 * REACH + 1
    tiles = tiles - tiles.mean(axis=(1, 2), keepdims=True)
    around = around - around.mean(axis=(2, 3), keepdims=True)
    product = np.fft.rfft2(around) * np.fft.rfft2(tiles, s=(size, size)).conj()[:, None]
    covariance = np.fft.irfft2(product, s=(size, size))[..., :count, :count]
    pixels = TILE**2
    variance = _sum_windows(around * around) - _sum_windows(around) ** 2 / pixels
    own = (tiles * tiles).sum(axis=(1, 2))[:, None, None, None]
    correlation: Plane = (covariance / np.sqrt(np.maximum(variance * own, 1e-9))).astype(np.float32)
    return correlation


def _sum_windows(values: Plane) -> Plane:
    """Returns the sums over each window of `TILE x TILE` of the last two axes: added in twos, then fours, and so on."""
    step = 1
    while step < TILE:
        values = values[..., :-step, :] + values[..., step:, :]
        values = values[..., :-step] + values[..., step:]
        step *= 2
    return values


def _make_weights() -> Plane:
    """Returns the weights of cubic interpolation from whole shifts to `SHIFTS`, `(shifts, 2*REACH + 1)`
    (Catmull-Rom).
    """
    far = np.abs(SHIFTS[:, None] - np.arange(-REACH, REACH + 1))
    near = np.where(far < 1, 1.5 * far**3 - 2.5 * far**2 + 1, -0.5 * far**3 + 2.5 * far**2 - 4 * far + 2)
    weights = np.where(far < 2, near, 0)
    normed: Plane = (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)
    return normed


_WEIGHTS = _make_weights()
