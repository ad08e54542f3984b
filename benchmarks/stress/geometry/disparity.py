"""Checks disparity maps of a rendered scene that is mirrored, transposed, reversed, shifted, and halved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.benchmarks.focus.scenes import render_exact
from ciir.benchmarks.stress.case import Found, Skipped
from ciir.renderer.focus.disparity import estimate_disparity
from ciir.renderer.light_field import LightField

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.benchmarks.stress.case import Case, Effort

SIDE = 192
BORDER = 12
"""Pixels at the border that are not compared, because shifted views wrap around there."""


def disparity_maps(effort: Effort) -> Iterator[Found | Skipped]:
    """Compares the disparity of a changed light field with the changed disparity, for 99 % of pixels or half, in pixels
    a view.
    """
    for name in ("globe",) if effort.quick else ("globe", "vase", "hamburger"):
        views = render_exact(name, Path(), side=SIDE).light_field.views
        found = _estimate(views)
        shifted = np.array(
            [[np.roll(view, (4 - v, 4 - u), (0, 1)) for u, view in enumerate(row)] for v, row in enumerate(views)]
        )
        changes = {
            "mirrored": (views[:, ::-1, :, ::-1], found[:, ::-1]),
            "upside down": (views[::-1, :, ::-1], found[::-1]),
            "transposed": (views.transpose(1, 0, 3, 2, 4), found.T),
            "views in reverse order": (views[::-1, ::-1], -found),
            "each view shifted by a pixel": (shifted, found + 1),
        }
        for change, (changed, expected) in changes.items():
            error = np.abs(_estimate(changed) - expected)[BORDER:-BORDER, BORDER:-BORDER]
            bound = 0.02 if "shifted" in change else 1e-4  # the range that is swept may differ by a plane
            yield Found(f"disparity of {name}, {change}", bound, float(np.quantile(error, 0.99)))
        blocks = (*views.shape[:2], SIDE // 2, 2, SIDE // 2, 2, views.shape[4])
        halved = views.reshape(blocks).mean(axis=(3, 5)).round().astype(np.uint8)
        error = np.abs(np.kron(2 * _estimate(halved), np.ones((2, 2))) - found)
        yield Found(f"disparity of {name}, half as large, median", 0.05, float(np.median(error)))


def _estimate(views: NDArray[Any]) -> NDArray[np.float32]:
    return estimate_disparity(LightField(np.ascontiguousarray(views))).disparity


CASES: tuple[Case, ...] = (disparity_maps,)
