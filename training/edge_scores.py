"""Learns which error an edge score stands for: the tables of `models.bounded`.

    python -m training.edge_scores [--pictures ../shared/data/images/train] [--out models/edge_scores.json]

Each shipped network of single pictures is run over photographs, as they are and made small in three ways, and over
rendered scenes as pinholes and lenslets see them, with those photographs as textures. Of each cell the mean square of
what separates the network's picture from bicubic interpolation is held against its edge score: the error of a score is
the quantile `QUANTILE` of the cells of about that score, of the kind of pictures where it is highest. Learns from no
picture of the test sets, nor from any of the shipped scenes. Needs the training extra.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from tqdm import tqdm

from models import bounded, catalogue
from models.baselines import Bicubic
from models.cells import CELL, edge_scores
from models.pixels import upscale_pixels
from models.skip import NOTHING
from training import degrade, pictures, rendered

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from models.upscaler import Upscaler
    from training.pictures import Picture

QUANTILE = 0.9
"""Of the errors of cells of about one score. A view's errors add up over hundreds of cells, most of them below it."""
SCORES = 2.0 ** np.arange(-4, 20)
"""Squared levels: the middles of the table's ranges, each from `2**-0.5` to `2**0.5` of it; the first from 0."""
FEWEST = 30
"""Cells of one kind of pictures and of about a score without which they say nothing of it."""
LEAST = 1e-3
"""Squared levels: no lower error is believed, as 8 bits hardly show it."""
PHOTOGRAPHS = 60
"""Taken evenly over their names. All are made small, each in one of three ways; every sixth is taken as it is, too."""
SCENES = 40
SEED = 77
"""Of the scenes; no recipe's."""
INSIDE, AWAY = 32, (3, 4, 5, 6, 7, 8)
"""Side of a window's kept middle, and the pixels around it that are tried."""
CUT = 0.5
"""Root mean square of levels within a pixel of the kept middle's border by which a window may differ from the whole."""


class Cells(NamedTuple):
    """Cells of some pictures."""

    scores: NDArray[np.float64]
    """`(n,)`, see `models.cells.edge_scores`."""
    errors: NDArray[np.float64]
    """`(n,)`, see `cell_errors`."""


def learnt_from(folder: Path) -> dict[str, list[Picture]]:
    """`(H, W, 3)` 8-bit pictures as upscalers are given them, of the photographs in `folder`, by their kind: the three
    ways to make them small, `photograph` as it is, `pinhole` and `lenslet`.
    """
    files = pictures.find(folder)
    files = files[:: max(1, len(files) // PHOTOGRAPHS)][:PHOTOGRAPHS]
    photographs = [pictures.read_rgb(path) for path in files]
    made: dict[str, list[Picture]] = {"photograph": photographs[::6]}
    for number, photograph in enumerate(photographs):
        kind = degrade.KINDS[number % len(degrade.KINDS)]
        low, _ = degrade.pair(kind, torch.from_numpy(photograph).permute(2, 0, 1), 2)
        made.setdefault(kind, []).append(np.ascontiguousarray(low.permute(1, 2, 0).numpy()))
    for index in range(SCENES):
        (pinhole, _), (lenslet, _) = rendered.pairs(photographs, seed=SEED, index=index)
        made.setdefault("pinhole", []).append(pinhole)
        made.setdefault("lenslet", []).append(lenslet)
    return made


def cell_errors(upscaler: Upscaler, picture: Picture) -> NDArray[np.float64]:
    """Of each cell of `(H, W, 3)`: the mean square of the levels by which what the network makes of it differs from
    interpolation, in the shape of `edge_scores`.
    """
    by_network, by_cubic = (
        upscale_pixels(model, picture[np.newaxis], skipping=NOTHING)[0] for model in (upscaler, Bicubic(upscaler.scale))
    )
    squares = np.square(by_network.astype(np.float64) - by_cubic).mean(axis=2)
    step = CELL * upscaler.scale
    height, width = squares.shape
    sums = np.add.reduceat(squares, np.arange(0, height, step), axis=0)
    sums = np.add.reduceat(sums, np.arange(0, width, step), axis=1)
    rows, cols = (np.minimum(step, side - np.arange(0, side, step)) for side in (height, width))
    return np.asarray(sums / np.multiply.outer(rows, cols))


def table(cells: Mapping[str, Cells]) -> list[tuple[float, float]]:
    """Ascending pairs of score and error, from the cells of pictures by their kind.

    Raises `ValueError` where less than `FEWEST` cells of a kind are of about any one score.
    """
    which = {kind: np.digitize(scores, SCORES[:-1] * 2**0.5) for kind, (scores, _) in cells.items()}
    made: list[tuple[float, float]] = []
    for number, score in enumerate(SCORES.tolist()):
        found = [errors[which[kind] == number] for kind, (_, errors) in cells.items()]
        found = [some for some in found if len(some) >= FEWEST]
        if found:
            before = made[-1][1] if made else LEAST
            made.append((score, max(before, *(float(np.quantile(some, QUANTILE)) for some in found))))
    if not made:
        raise ValueError(f"less than {FEWEST} cells of about any one score; give more or larger pictures")
    return made


def around(upscaler: Upscaler, given: Sequence[Picture]) -> int:
    """The fewest of `AWAY` pixels that a window needs around what is kept of it to come within `CUT` of the whole; the
    network's radius where none does.
    """
    side = INSIDE + 2 * AWAY[-1]
    large = [picture[:side, :side] for picture in given if min(picture.shape[:2]) >= side]
    stack = np.stack(large)
    scale, start = upscaler.scale, AWAY[-1]
    whole = upscale_pixels(upscaler, stack, skipping=NOTHING).astype(np.float64)
    inner = slice(start * scale, (start + INSIDE) * scale)
    ring = np.ones((INSIDE * scale, INSIDE * scale), np.bool_)
    ring[scale:-scale, scale:-scale] = False
    for away in AWAY:
        part = slice(start - away, start + INSIDE + away)
        made = upscale_pixels(upscaler, np.ascontiguousarray(stack[:, part, part]), skipping=NOTHING)
        kept = slice(away * scale, (away + INSIDE) * scale)
        off = (made[:, kept, kept] - whole[:, inner, inner])[:, ring]
        if np.sqrt(np.square(off).mean()) <= CUT:
            return min(away, upscaler.radius)
    return upscaler.radius


def learn(upscaler: Upscaler, given: Mapping[str, Sequence[Picture]]) -> dict[str, Any]:
    """One entry of the file: what `models.bounded.Table` takes, rounded."""
    cells = {}
    for kind, some in given.items():
        scores = [edge_scores(picture).ravel().astype(np.float64) for picture in some]
        said = tqdm(some, disable=None, desc=f"{upscaler.name}, {kind}", unit="picture", leave=False)
        cells[kind] = Cells(
            np.concatenate(scores), np.concatenate([cell_errors(upscaler, one).ravel() for one in said])
        )
    pairs = table(cells)
    return {
        "around": around(upscaler, [picture for some in given.values() for picture in some]),
        "scores": [round(score, 4) for score, _ in pairs],
        "errors": [round(error, 4) for _, error in pairs],
    }


def main(argv: list[str] | None = None) -> int:
    """Writes the tables of all shipped networks of single pictures that this processor runs."""
    parser = argparse.ArgumentParser(prog="training.edge_scores", description=main.__doc__)
    parser.add_argument("--pictures", type=Path, default=Path("../shared/data/images/train"), help="photographs")
    parser.add_argument("--out", type=Path, default=bounded.TABLES, help=f"(default {bounded.TABLES.name} in models)")
    given = parser.parse_args(argv)
    learnt = learnt_from(given.pictures)
    made = []
    for entry in catalogue.entries():
        if entry.card is None or entry.is_light_field:
            continue
        if entry.unsuited:
            parser.error(f"{entry.name}: {entry.unsuited}; run this on another machine, so that every table is written")
        made.append({"name": entry.name, "sha256": entry.card.sha256} | learn(catalogue.load(entry.name), learnt))
        sys.stdout.write(f"{entry.name:16s}{len(made[-1]['scores']):4d} scores, sees {made[-1]['around']} around\n")
        sys.stdout.flush()
    said = {
        "learnt_on": f"{sum(map(len, learnt.values()))} pictures: photographs of BSDS500 (train and test), as they are "
        f"and made small by {', '.join(degrade.KINDS)}; {SCENES} rendered scenes as pinholes and lenslets see them",
        "command": "python -m training.edge_scores",
        "cell": CELL,
        "quantile": QUANTILE,
        "tables": made,
    }
    given.out.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
