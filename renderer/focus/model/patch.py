"""The surface that one view shows: a small square for each pixel, joined to neighbours with about the same disparity.

Each square has a vertex in the pixel's centre, with its colour and its disparity, and one in each corner, with the mean
of the pixels that meet there on one surface. A cut surface thus ends half a pixel beyond its last pixel's centre, where
the view has its edge, and no colour of one side is on the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Patch:
    """Triangles in a view's pixels."""

    x: NDArray[np.float64]
    """`(n,)`: columns, 0 in the middle of the first."""
    y: NDArray[np.float64]
    """`(n,)`: rows, 0 in the middle of the first."""
    disparity: NDArray[np.float64]
    """`(n,)`."""
    colors: NDArray[np.float64]
    """`(n, 3)`, in the units of the picture."""
    faces: NDArray[np.int64]
    """`(m, 3)`."""


def make_patch(
    picture: NDArray[Any], disparity: NDArray[np.floating], is_used: NDArray[np.bool_], most: float
) -> Patch:
    """Makes four triangles for each pixel of `picture`, `(H, W, 3)`, that `is_used`, `(H, W)`.

    Pixels that meet in a corner are joined there unless their `disparity`, `(H, W)`, jumps by over `most` between them:
    in the order of disparities, those up to the jump are one surface, and those after it another.
    """
    height, width = disparity.shape
    around = [(slice(a, height + 1 + a), slice(b, width + 1 + b)) for a in (0, 1) for b in (0, 1)]
    padded = np.pad(np.where(is_used, disparity, np.inf), 1, constant_values=np.inf)
    four = np.stack([padded[place] for place in around])  # (4, H + 1, W + 1): the pixels that meet in a corner
    coloured = np.pad(picture.astype(np.float64), ((1, 1), (1, 1), (0, 0)))
    colours = np.stack([coloured[place] for place in around])  # (4, H + 1, W + 1, 3)

    order = four.argsort(axis=0)
    ranked = np.take_along_axis(four, order, axis=0)
    with np.errstate(invalid="ignore"):  # between two pixels that are not used
        jumps = np.diff(ranked, axis=0, prepend=ranked[:1]) > most
    surface = np.empty_like(order)
    np.put_along_axis(surface, order, jumps.cumsum(axis=0), axis=0)  # 0 to 3: the number of the surface in its corner

    found = np.zeros((4, height + 1, width + 1, 4))  # disparity and colour of each surface in each corner
    for number in range(4):
        share = ((surface == number) & np.isfinite(four)).astype(np.float64)
        share /= np.maximum(share.sum(axis=0), 1)
        found[number, ..., 0] = (share * np.where(np.isfinite(four), four, 0)).sum(axis=0)
        found[number, ..., 1:] = np.einsum("kyx,kyxc->yxc", share, colours)

    y, x = np.nonzero(is_used)
    corners = [  # for each pixel: upper left, upper right, lower left, lower right
        len(y) + np.ravel_multi_index((surface[3 - 2 * a - b, y + a, x + b], y + a, x + b), found.shape[:3])
        for a in (0, 1)
        for b in (0, 1)
    ]
    ring = [corners[i] for i in (1, 0, 2, 3, 1)]  # counter-clockwise as seen from the array
    middle = np.arange(len(y))
    triangles = [np.stack([middle, *pair], axis=1) for pair in pairwise(ring)]
    every, faces = np.unique(np.concatenate(triangles), return_inverse=True)
    corner = every[len(y) :] - len(y)  # each pixel's middle is used
    _, corner_y, corner_x = np.unravel_index(corner, found.shape[:3])
    values = found.reshape(-1, 4)[corner]
    return Patch(
        x=np.concatenate([x, corner_x - 0.5]),
        y=np.concatenate([y, corner_y - 0.5]),
        disparity=np.concatenate([disparity[y, x], values[:, 0]]),
        colors=np.concatenate([picture[y, x], values[:, 1:]]),
        faces=faces.reshape(-1, 3),
    )
