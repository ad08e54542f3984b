"""Where the rays of a light field's views meet slanted sheets, and sheets that turn away at an edge.

A sheet's point q, in LR pixels from the middle of the view in the middle, is seen by the view `offset` = (down, right)
of it at `p = q + (disparity + slope . q) * offset`. That is linear in q, so it is turned round once for a whole view.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

if TYPE_CHECKING:
    import numpy as np

CHANGE = (0.1, 3.0)
"""By how much the disparity of what turned away changes over an LR pixel, evenly in the logarithm."""
WIDTH = (0.2, 4.0)
"""How wide it is in the middle view, LR pixels."""
MOST = 1.5
"""How much its disparity changes at most."""
EDGE_ON = 0.02
"""Share of its width below which it is too thin to be seen."""


class AffineMap(NamedTuple):
    """Of each view, `matrix @ p + shift` for a pixel p: `(V, n, 2)` and `(V, n)`."""

    matrix: Tensor
    shift: Tensor

    def then(self, matrix: Tensor, shift: Tensor) -> AffineMap:
        """`matrix @ . + shift` of it, `(m, n)` and `(m,)`."""
        return AffineMap(matrix @ self.matrix, self.shift @ matrix.T + shift)

    def of(self, along: Tensor) -> Tensor:
        """For pixels at `along` down and across, `(side,)`: `(V, side, side, n)`."""
        down = self.matrix[:, None, :, 0] * along[:, None] + self.shift[:, None]
        across = self.matrix[:, None, :, 1] * along[:, None]
        return down[:, :, None] + across[:, None]


def intersect_layer(offsets: Tensor, disparity: Tensor, slope: Tensor) -> AffineMap:
    """The point q of a sheet that each pixel of the views at `offsets` `(V, 2)` sees. `slope`: `(2,)`."""
    beside = offsets[:, :, None] * slope / (1 + offsets @ slope)[:, None, None]
    matrix = torch.eye(2, dtype=offsets.dtype) - beside  # the inverse of I + offset slope^T (Sherman and Morrison)
    return AffineMap(matrix, -disparity * (matrix @ offsets[:, :, None])[:, :, 0])


class Fold(NamedTuple):
    """A strip along the straight edge of a sheet, beyond it, whose disparity changes fast across: a roof behind a wall,
    or a shelf before it.

    Some views see it, and some don't; the middle one always does, if only a fifth of a pixel of it. A view behind it
    sees nothing of it: of a shelf its back would hide a part of the sheet, which is left out.
    """

    normal: Tensor
    """`(2,)`, of length 1: across the edge, towards the sheet."""
    edge: float
    """Where the edge is along it, LR pixels from the middle."""
    change: float
    """Of the disparity, over an LR pixel."""
    width: float
    """In the middle view, LR pixels."""

    def seen(self, along: Tensor, offsets: Tensor, disparity: Tensor, slope: Tensor) -> Tensor:
        """How much of each pixel it fills, `(V, side, side)` in [0, 1]. `disparity` and `slope` are the sheet's;
        `along` as in `AffineMap.of`, evenly spaced: a pixel's width is the distance of the first two.
        """
        slope = slope + self.change * self.normal
        ahead = 1 + offsets @ slope  # how wide a pixel of the middle view is seen; below 0 from behind: not at all
        visible = ahead > EDGE_ON
        ahead = torch.where(visible, ahead, torch.ones_like(ahead))
        found = intersect_layer(torch.where(visible[:, None], offsets, 0.0), disparity - self.change * self.edge, slope)
        inwards = found.then(self.normal[None], torch.tensor([-self.edge])).of(along)[..., 0]
        pixel = float(along[1] - along[0]) / ahead[:, None, None]
        there = ((inwards + self.width) / pixel + 0.5).clamp(0, 1)
        # It goes on for a pixel under the sheet, that nothing shines through where they meet.
        return there * (1.5 - inwards / pixel).clamp(0, 1) * visible[:, None, None]


def make_fold(random: np.random.Generator, normal: Tensor, edge: float) -> Fold:
    """One along an edge: see there."""
    low, high = CHANGE
    change = math.exp(random.uniform(math.log(low), math.log(high))) * (1 if random.random() < 0.5 else -1)
    return Fold(normal, edge, change, min(random.uniform(*WIDTH), MOST / abs(change)))
