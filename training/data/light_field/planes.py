"""Intersection of the rays of a light field's views with slanted layers, and layers with a fold at an edge.

The view at `offset` = (down, right) from the middle view sees a layer's point q, in LR pixels from the centre of the
middle view, at `p = q + (disparity + slope . q) * offset`. This is linear in q, so it is inverted once for a view.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

if TYPE_CHECKING:
    import numpy as np

CHANGE = (0.1, 3.0)
"""Change of a fold's disparity over an LR pixel, evenly in the logarithm."""
WIDTH = (0.2, 4.0)
"""Width of a fold in the middle view, LR pixels."""
MOST = 1.5
"""Largest change of a fold's disparity over its width."""
EDGE_ON = 0.02
"""Share of its width below which a fold is not visible."""


class AffineMap(NamedTuple):
    """`matrix @ p + shift` for a pixel p of each view: `(V, n, 2)` and `(V, n)`."""

    matrix: Tensor
    shift: Tensor

    def compose(self, matrix: Tensor, shift: Tensor) -> AffineMap:
        """Returns the map followed by `matrix @ . + shift`, `(m, n)` and `(m,)`."""
        return AffineMap(matrix @ self.matrix, self.shift @ matrix.T + shift)

    def apply(self, along: Tensor) -> Tensor:
        """Returns the map at pixels `along` down and across, `(side,)`: `(V, side, side, n)`."""
        down = self.matrix[:, None, :, 0] * along[:, None] + self.shift[:, None]
        across = self.matrix[:, None, :, 1] * along[:, None]
        return down[:, :, None] + across[:, None]


def intersect_layer(offsets: Tensor, disparity: Tensor, slope: Tensor) -> AffineMap:
    """Maps pixels of the views at `offsets` `(V, 2)` to the points q of a layer. `slope`: `(2,)`."""
    beside = offsets[:, :, None] * slope / (1 + offsets @ slope)[:, None, None]
    matrix = torch.eye(2, dtype=offsets.dtype) - beside  # the inverse of I + offset slope^T (Sherman and Morrison)
    return AffineMap(matrix, -disparity * (matrix @ offsets[:, :, None])[:, :, 0])


class Fold(NamedTuple):
    """A strip beyond the straight edge of a layer whose disparity changes fast across it, like a roof behind a wall.

    Only some views see it; the middle one always sees at least a fifth of a pixel, a view from behind nothing.
    """

    normal: Tensor
    """`(2,)`, of length 1: across the edge, towards the layer."""
    edge: float
    """Position of the edge along the normal, LR pixels from the centre."""
    change: float
    """Change of the disparity over an LR pixel."""
    width: float
    """Width in the middle view, LR pixels."""

    def coverage(self, along: Tensor, offsets: Tensor, disparity: Tensor, slope: Tensor) -> Tensor:
        """Share of each pixel that the fold covers, `(V, side, side)` in [0, 1]. `disparity` and `slope`: the layer's.
        `along` is as in `AffineMap.apply`, evenly spaced: a pixel's width is the distance of the first two.
        """
        slope = slope + self.change * self.normal
        width = 1 + offsets @ slope  # of a pixel of the middle view in each view; below 0 from behind
        visible = width > EDGE_ON
        width = torch.where(visible, width, torch.ones_like(width))
        found = intersect_layer(torch.where(visible[:, None], offsets, 0.0), disparity - self.change * self.edge, slope)
        inwards = found.compose(self.normal[None], torch.tensor([-self.edge])).apply(along)[..., 0]
        pixel = float(along[1] - along[0]) / width[:, None, None]
        there = ((inwards + self.width) / pixel + 0.5).clamp(0, 1)
        # It continues for a pixel under the layer, so that there is no gap where they meet.
        return there * (1.5 - inwards / pixel).clamp(0, 1) * visible[:, None, None]


def make_fold(random: np.random.Generator, normal: Tensor, edge: float) -> Fold:
    """Draws a random fold along an edge: see `Fold`."""
    low, high = CHANGE
    change = math.exp(random.uniform(math.log(low), math.log(high))) * (1 if random.random() < 0.5 else -1)
    return Fold(normal, edge, change, min(random.uniform(*WIDTH), MOST / abs(change)))
