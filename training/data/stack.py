"""Pairs of pictures in two buffers on a device, from which whole batches are cut there.

A GPU takes more crops per second than a CPU can cut. Here a batch is two gathers on the device, including all flips and
rotations.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch

from ciir.cores import count_available_cores

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray
    from torch import Tensor

    from ciir.training.data.downscale import Pair

ORIENTATIONS = 8
"""Four rotations, each with and without a flip."""


class Places(NamedTuple):
    """The places of a batch's crops: arrays with one number for each crop."""

    pair: NDArray[np.int64]
    y: NDArray[np.int64]
    """Row of the crop's first LR sample."""
    x: NDArray[np.int64]
    orientation: NDArray[np.int64]
    """0 to `ORIENTATIONS`, exclusive."""


def orient(picture: NDArray[np.generic], orientation: int) -> NDArray[np.generic]:
    """Rotates `(H, W, ...)` by 90 degrees `orientation // 2` times, then flips it if `orientation` is odd."""
    turned = np.rot90(picture, orientation // 2)
    return turned[:, ::-1] if orientation % 2 else turned


class PairStack:
    """Read-only pairs on a device."""

    def __init__(
        self,
        sizes: NDArray[np.int64],
        make_pair: Callable[[int], Pair],
        *,
        side: int,
        scale: int,
        device: torch.device,
    ) -> None:
        """`sizes`: the rows and columns of each pair's LR, `(n, 2)`. `make_pair` is called once for each pair, in
        threads. `side`: the side of an LR crop.
        """
        self.scale = scale
        low, high = _Layout(sizes), _Layout(sizes * scale)
        lows, highs = (np.empty((layout.total, 3), np.uint8) for layout in (low, high))

        def fill(index: int) -> None:
            pair = make_pair(index)
            for layout, pixels, picture in ((low, lows, pair.low), (high, highs, pair.high)):
                start = layout.starts[index]
                pixels[start : start + picture.shape[0] * picture.shape[1]] = picture.reshape(-1, 3)

        with ThreadPoolExecutor(count_available_cores()) as pool:
            list(pool.map(fill, range(len(sizes))))  # a list, so that errors are raised
        self._low = _Buffer(low, lows, side, device)
        self._high = _Buffer(high, highs, side * scale, device)

    def cut(self, places: Places) -> tuple[Tensor, Tensor]:
        """Cuts crops, 8-bit LR `(N, side, side, 3)` and HR `(N, scale*side, scale*side, 3)`, on the device."""
        fine = places._replace(y=places.y * self.scale, x=places.x * self.scale)
        return self._low.cut(places), self._high.cut(fine)


class _Layout:
    """The places of pictures in a buffer, one after the other."""

    def __init__(self, sizes: NDArray[np.int64]) -> None:
        ends = np.cumsum(sizes.prod(axis=1))
        self.starts, self.total = ends - sizes.prod(axis=1), int(ends[-1])
        self.widths = sizes[:, 1]


class _Buffer:
    """Pictures of several sizes in one tensor on a device."""

    def __init__(self, layout: _Layout, pixels: NDArray[np.uint8], side: int, device: torch.device) -> None:
        self._layout, self._pixels = layout, torch.from_numpy(pixels).to(device)  # (total, 3)
        grid = np.arange(side)
        # The row and column of each pixel of a crop, (ORIENTATIONS, side, side).
        self._rows, self._cols = (
            torch.from_numpy(np.stack([orient(place, orientation) for orientation in range(ORIENTATIONS)])).to(device)
            for place in np.meshgrid(grid, grid, indexing="ij")
        )

    def cut(self, places: Places) -> Tensor:
        """Cuts the crops whose first pixels are at `places`: `(N, side, side, 3)`."""
        widths = self._layout.widths[places.pair]
        first = self._layout.starts[places.pair] + places.y * widths + places.x
        numbers = torch.from_numpy(np.stack([first, widths, places.orientation])).to(self._pixels.device)
        origin, stride, orientation = numbers.unsqueeze(-1).unsqueeze(-1)
        rows, cols = (grid[orientation[:, 0, 0]] for grid in (self._rows, self._cols))
        return self._pixels[origin + rows * stride + cols]
