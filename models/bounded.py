"""What of a picture may be interpolated: where the network would hardly change what bicubic interpolation makes.

How far the two differ is predicted from the picture alone, by a table that was learnt from photographs and rendered
scenes: from a cell's edge score (`models.cells`) to its squared error, as ARM does it (Chen et al., ECCV 2022), with no
second network. A view's predicted errors are added up, and rectangles of it are interpolated, the best bargains first
(`models.partition`), until the sum would pass the bound. See docs/skipping.md.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.baselines import SCALES, Bicubic
from models.cells import areas, edge_scores
from models.partition import windows

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.cells import Depth, Floats
    from models.partition import Window
    from models.skip import Tally
    from models.upscaler import Upscaler

TABLES = Path(__file__).parent / "edge_scores.json"
"""Written by `python -m training.edge_scores`: a table for each network, by the SHA-256 of its file."""
AIM = 0.9
"""Share of the bound that predicted errors add up to: no table knows every picture."""
LEAST = 64 * 64
"""Pixels below which a picture goes whole: looking at it takes a fifth as long as the network, and seldom pays."""


class Table(NamedTuple):
    """The error that an edge score stands for."""

    scores: NDArray[np.float64]
    """`(n,)`, ascending, squared levels (of 255)."""
    errors: NDArray[np.float64]
    """`(n,)`, ascending: mean square of the levels by which network and interpolation differ. Beyond the last score
    nothing was learnt: no bound holds there."""
    around: int
    """Pixels that a window sees around what is kept of it: fewer than the network's radius, as what is farther away
    changes less than the bounds that are of use."""

    def predicted(self, scores: Floats) -> NDArray[np.float64]:
        """Mean square error of cells of these scores, of any shape; inf beyond what was learnt."""
        logs = np.interp(np.log(np.maximum(scores, self.scores[0])), np.log(self.scores), np.log(self.errors))
        return np.where(scores <= self.scores[-1], np.exp(logs), np.inf)


@lru_cache(maxsize=1)
def tables() -> dict[str, Table]:
    """All shipped tables, by the SHA-256 of the network."""
    said = json.loads(TABLES.read_text(encoding="utf-8"))["tables"]
    return {
        one["sha256"]: Table(np.array(one["scores"], float), np.array(one["errors"], float), one["around"])
        for one in said
    }


def table_of(upscaler: Upscaler) -> Table | None:
    """An upscaler's table; None where none was learnt for it, and nothing of its pictures is interpolated."""
    card = getattr(upscaler, "card", None)
    return tables().get(card.sha256) if card is not None else None


def upscale(
    run: Callable[[Upscaler, NDArray[Depth]], NDArray[Depth]],
    upscaler: Upscaler,
    pictures: NDArray[Depth],
    max_error: float,
    tally: Tally,
    *,
    of: int = 0,
) -> NDArray[Depth]:
    """`(N, H, W, C)` -> `(N, scale*H, scale*W, C)`: `run(upscaler, pictures)` to within a predicted error.

    `max_error`: root mean square of levels (of 255), over all channels of each picture, by which the result may differ;
    `of`: the pixels that it is the mean over where `pictures` are parts of larger ones. What is interpolated is added
    to `tally`. Whole go pictures with alpha, those of a network without a table, and those that are so small or so
    detailed that windows and what they see around would take as long.
    """
    count, height, width, channels = pictures.shape
    table = table_of(upscaler)
    if table is None or channels in (2, 4) or upscaler.scale not in SCALES or height * width < LEAST:
        return run(upscaler, pictures)
    budget = (AIM * max_error) ** 2 * max(of, height * width)
    plans = []
    for picture in pictures:
        cells = table.predicted(edge_scores(picture)) * areas(height, width)
        plans.append(windows(cells, height, width, table.around, budget))
    whole = [number for number, plan in enumerate(plans) if plan is None]
    if len(whole) == count:
        return run(upscaler, pictures)
    result = run(Bicubic(upscaler.scale), pictures)
    if whole:
        result[whole] = run(upscaler, pictures[whole])
    wanted: dict[tuple[int, int], list[tuple[int, Window]]] = {}
    for number, plan in enumerate(plans):
        if plan is not None:
            tally.interpolated += height * width - sum(window.kept for window in plan)
            for window in plan:
                wanted.setdefault((window.height, window.width), []).append((number, window))
    for (rows, cols), some in wanted.items():
        parts = np.stack([pictures[n, w.top : w.top + rows, w.left : w.left + cols] for n, w in some])
        for (number, window), large in zip(some, run(upscaler, parts), strict=True):
            window.put(large, result[number], upscaler.scale)
    return result
