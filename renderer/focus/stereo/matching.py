"""Semi-global matching (Hirschmueller, PAMI 30, 2008) over four directions, and the fit between planes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

SMALL_STEP, LARGE_STEP = 1.0, 20.0
"""Cost for a pixel to lie one plane from its neighbour, and further away: in 8-bit levels."""
EDGE = 8.0
"""8-bit levels between two pixels that halve the cost of a large step."""
UNSURE = 8.0
"""8-bit levels over all paths by which the usual plane fits worse than a perfect one when confidence is 1/2."""


def match(
    cost: NDArray[np.float32], guide: NDArray[np.float32], planes: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Returns the disparity of each pixel and its confidence, from 0 if all planes fit equally well, to 1; both
    `(H, W)`.

    `cost`: `(n, H, W)`, how badly each of the n evenly spaced `planes` fits, in 8-bit levels. `guide`: `(C, H, W)`, the
    view, whose edges may be edges of depth.
    """
    total, across = np.zeros_like(cost), np.zeros_like(cost)
    with ThreadPoolExecutor(2) as pool:
        turned = (volume.transpose(0, 2, 1) for volume in (across, cost, guide))
        waits = pool.submit(_add_paths, total, cost, guide), pool.submit(_add_paths, *turned)
    for wait in waits:
        wait.result()
    total += across
    best = total.argmin(axis=0)
    middle = np.clip(best, 1, len(planes) - 2)
    before, at, after = (np.take_along_axis(total, (middle + step)[np.newaxis], 0)[0] for step in (-1, 0, 1))
    steepest = np.maximum(np.maximum(before, after) - at, 1e-6)
    fraction = np.clip((before - after) / (2 * steepest), -1, 1)
    usual = total.mean(axis=0)
    confidence = (usual - np.take_along_axis(total, best[np.newaxis], 0)[0]) / (usual + UNSURE)
    return (planes[0] + (planes[1] - planes[0]) * (middle + fraction)).astype(np.float32), confidence


def _add_paths(total: NDArray[np.float32], cost: NDArray[np.float32], guide: NDArray[np.float32]) -> None:
    """Adds the costs of the paths from the top and from the bottom to `total`."""
    edges = np.abs(np.diff(guide, axis=1)).max(axis=0)  # (H - 1, W)
    jumps = np.maximum(LARGE_STEP / (1 + edges / EDGE), 1.5 * SMALL_STEP).astype(np.float32)
    count = cost.shape[1]
    _add_path(total, cost, jumps, range(count))
    _add_path(total, cost, jumps[::-1], range(count - 1, -1, -1))


def _add_path(
    total: NDArray[np.float32], cost: NDArray[np.float32], jumps: NDArray[np.float32], rows: Iterable[int]
) -> None:
    """Adds the cost of the cheapest path to each pixel through `rows` in their order (equation 13)."""
    path: NDArray[np.float32] | None = None
    for number, row in enumerate(rows):
        own = np.ascontiguousarray(cost[:, row])  # (n, W)
        if path is not None:
            least = path.min(axis=0)
            change = np.minimum(path, least + jumps[number - 1])
            np.minimum(change[1:], path[:-1] + SMALL_STEP, out=change[1:])
            np.minimum(change[:-1], path[1:] + SMALL_STEP, out=change[:-1])
            own += change - least
        total[:, row] += own
        path = own
