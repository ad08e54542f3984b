"""Intersection of the rays of a light field's views with slanted layers, and layers with a fold at an edge.

The view at `offset` = (down, right) from the middle view sees a layer's point q, in LR pixels from the centre of the
middle view, at `p = q + (disparity + slope . q) * offset`. This is linear in q, so it is inverted once for each view.

Everything is computed for `N` scenes at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

if TYPE_CHECKING:
    from numpy.typing import NDArray

CHANGE = (0.1, 3.0)
"""Range of the change of a fold's disparity over an LR pixel, uniform in the logarithm."""
WIDTH = (0.2, 4.0)
"""Range of the width of a fold in the middle view, LR pixels."""
MOST = 1.5
"""Largest change of a fold's disparity over its width."""
EDGE_ON = 0.02
"""A fold is not visible in a view that sees less than this share of its width."""


class AffineMap(NamedTuple):
    """The map `matrix @ p + shift` of a pixel p of each view: `(N, V, n, 2)` and `(N, V, n)`."""

    matrix: Tensor
    shift: Tensor

    def compose(self, matrix: Tensor, shift: Tensor) -> AffineMap:
        """Returns the map followed by `matrix @ . + shift`, `(N, m, n)` and `(N, m)`."""
        shifted = (matrix[:, None] @ self.shift[..., None])[..., 0] + shift[:, None]
        return AffineMap(matrix[:, None] @ self.matrix, shifted)

    def apply(self, along: Tensor) -> Tensor:
        """Applies the map at pixels `along` down and across, `(side,)`: `(N, V, side, side, n)`."""
        down = self.matrix[:, :, None, :, 0] * along[:, None] + self.shift[:, :, None]
        across = self.matrix[:, :, None, :, 1] * along[:, None]
        return down[:, :, :, None] + across[:, :, None]

    def select(self, view: int) -> AffineMap:
        """Returns the map of one view."""
        return AffineMap(self.matrix[:, view : view + 1], self.shift[:, view : view + 1])


def intersect_layer(offsets: Tensor, disparity: Tensor, slope: Tensor) -> AffineMap:
    """Returns the map from pixels of the views at `offsets`, `(V, 2)` or `(N, V, 2)`, to the points q of a layer of
    each scene. `disparity`: `(N,)`, `slope`: `(N, 2)`.
    """
    offsets = offsets.expand(len(slope), *offsets.shape[-2:])
    along = (offsets @ slope[:, :, None])[..., 0]
    beside = offsets[..., None] * slope[:, None, None] / (1 + along)[..., None, None]
    matrix = torch.eye(2, dtype=offsets.dtype, device=offsets.device) - beside  # Sherman and Morrison
    return AffineMap(matrix, -disparity[:, None, None] * (matrix @ offsets[..., None])[..., 0])


class Fold(NamedTuple):
    """A strip beyond the straight edge of a layer. Its disparity changes fast across it, like a roof behind a wall.

    Only some views see it. The middle one always sees at least a fifth of a pixel, and a view from behind sees nothing.
    """

    normal: Tensor
    """Unit vector across the edge, towards the layer, `(N, 2)`."""
    edge: Tensor
    """Position of the edge along the normal, LR pixels from the centre, `(N,)`."""
    change: Tensor
    """Change of the disparity over an LR pixel, `(N,)`."""
    width: Tensor
    """Width in the middle view, LR pixels, `(N,)`."""

    def coverage(self, along: Tensor, offsets: Tensor, disparity: Tensor, slope: Tensor) -> Tensor:
        """Computes the share of each pixel that the fold covers, `(N, V, side, side)` in [0, 1]. `disparity` and
        `slope` are the layer's. `along` is as in `AffineMap.apply` and evenly spaced, so the distance of the first two
        is a pixel's width.
        """
        slope = slope + self.change[:, None] * self.normal
        width = 1 + slope @ offsets.T  # (N, V): of a pixel of the middle view in each view; below 0 from behind
        visible = width > EDGE_ON
        width = torch.where(visible, width, torch.ones_like(width))
        found = intersect_layer(
            torch.where(visible[..., None], offsets, 0.0), disparity - self.change * self.edge, slope
        )
        inwards = found.compose(self.normal[:, None], -self.edge[:, None]).apply(along)[..., 0]
        pixel = (along[1] - along[0]) / width[..., None, None]
        there = ((inwards + self.width[:, None, None, None]) / pixel + 0.5).clamp(0, 1)
        # It extends a pixel under the layer, so that there is no gap where they meet.
        return there * (1.5 - inwards / pixel).clamp(0, 1) * visible[..., None, None]


def draw_log_uniform(
    random: np.random.Generator, ends: tuple[float, float], shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Draws numbers between two ends, uniformly in the logarithm."""
    low, high = np.log(ends)
    return np.exp(random.uniform(low, high, shape))


def draw_folds(random: np.random.Generator, count: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Draws the change and the width of `count` folds; see `Fold`."""
    change = draw_log_uniform(random, CHANGE, (count,)) * random.choice((-1, 1), count)
    width = np.minimum(random.uniform(*WIDTH, count), MOST / np.abs(change))
    return change.astype(np.float32), width.astype(np.float32)
