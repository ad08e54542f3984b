"""Every network at an equal budget: the paper's table 2 (blocks, batch normalisation) and table 3 (other networks).

    python -m ciir.benchmarks.peers [--updates 1500] [--crop 48] [--batch 16] [--only NAME ...] [--all] [--out
    runs/peers]

All are trained by `training.loop.train.train` on the same crops in the same order, with the same number of updates,
pixel
loss and step sizes, and scored on the public sets after export; SRGAN's and ESRGAN's generators too have pixel loss.
RDN and ESRGAN's are only timed where there is no GPU, unless `--all` asks for them. Stop it at any time: started again
with the same options it goes on where it was. `--out` gets a folder for each network (its checkpoint, log, ONNX file
and card), `tables.md`, and `figures.json` with every figure. Needs the training extra.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tqdm import tqdm

from ciir.benchmarks import peers_tables
from ciir.benchmarks.peers_tables import Figures
from ciir.models import cards
from ciir.models.cards import Sizes
from ciir.models.catalogue import BASELINES
from ciir.models.sessions import open_session
from ciir.models.upscaler import clip_output
from ciir.training.evaluation.pictures import score
from ciir.training.export import export, measure, to_onnx
from ciir.training.loop import checkpoints
from ciir.training.loop.interrupt import Stopped
from ciir.training.loop.run import Run
from ciir.training.loop.train import train
from ciir.training.networks import make_network
from ciir.training.recipe import Recipe

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray
    from torch import nn

    from ciir.models.cards import Accuracy

SETS = ("Set5", "Set14", "BSD100")
LEARNING_RATE = 5e-4
"""Adam's peak step size, for all: after a warm-up over a twentieth of the updates, then along a half cosine to zero.
Four times as much breaks the 16 blocks without batch normalisation."""
VIEW = 200
"""Side of the view whose upscaling is timed, pixels."""
SCALE = 2


@dataclass(frozen=True)
class Peer:
    """A row that is trained."""

    label: str
    network: str
    options: dict[str, Any] = field(default_factory=dict)
    large: bool = False
    """Too much for a few CPU cores, and too wide a field for tiles: it can't ship."""


BLOCKS = (3, 6, 16)
BASIS = "lite-6"
"""The network that updates are timed against: the paper's."""
PEERS = {
    "srcnn": Peer("SRCNN 9-5-5", "srcnn"),
    "fsrcnn": Peer("FSRCNN", "fsrcnn"),
    "vdsr": Peer("VDSR", "vdsr"),
    "rdn": Peer("RDN", "rdn", large=True),
    "srgan": Peer("SRGAN's generator", "srgan"),
    "rrdb": Peer("ESRGAN's generator", "rrdb", large=True),
    "sparse-camera": Peer("sparse camera array", "sparse_camera"),
    **{
        f"lite-{blocks}{'-bn' * batch_norm}": Peer(
            f"lite, {blocks} blocks{', BN' * batch_norm}", "lite", {"blocks": blocks, "batch_norm": batch_norm}
        )
        for blocks in BLOCKS
        for batch_norm in (False, True)
    },
    "fast-equal": Peer("ours, fast", "compact", {"widths": [32, *[48] * 6], "slope": 0.0}),
    "quality-equal": Peer("ours, quality", "compact", {"widths": [64] * 8}),
}
"""Name of the run -> what is trained."""
TABLE_2 = tuple(name for name in PEERS if name.startswith("lite-"))
TABLE_3 = (*BASELINES, *(name for name in PEERS if name not in TABLE_2 or name == BASIS))


def recipe(name: str, *, updates: int, crop: int, batch: int, data: Path) -> Recipe:
    """What the network `name` is trained by: its design and options apart, the same for all."""
    return Recipe(
        name=name,
        network=PEERS[name].network,
        options=PEERS[name].options,
        train=(data / "train").as_posix(),
        validate=(data / "Set5").as_posix(),
        steps=updates,
        scale=SCALE,
        crop=crop,
        batch=batch,
        learning_rate=LEARNING_RATE,
        warmup=updates // 20,
        clip=0.5,
        bfloat16=True,
        seed=656,
        validate_every=max(1, updates // 5),
    )


class Whole:
    """A network as an `Upscaler` that takes each picture whole: for fields too wide for tiles."""

    radius = 0

    def __init__(self, name: str, network: nn.Module) -> None:
        self.name, self.scale = name, SCALE
        self.session = open_session(to_onnx.convert_network(network, SCALE), os.cpu_count() or 1)

    def __call__(self, images: NDArray[np.float32]) -> NDArray[np.float32]:
        """See `Upscaler.__call__`."""
        (output,) = self.session.run(None, {to_onnx.INPUT: images})
        return clip_output(np.array(output), self.name)


def accuracy(name: str, checkpoint: Path, sets: Sequence[Path]) -> tuple[Accuracy, ...]:
    """Scores of a finished run on `sets`, through its ONNX file and card, which stay beside the checkpoint."""
    if PEERS[name].large:
        network = export.simplify_network(export.load_network(checkpoints.read_checkpoint(checkpoint)))
        return tuple(score(Whole(name, network), folder) for folder in sets)
    card = checkpoint.with_name(f"{name}.json")
    if not card.exists() or card.stat().st_mtime < checkpoint.stat().st_mtime:
        export.export_network(checkpoint, card.parent, accuracy_on=sets)
    return cards.read_card(card).accuracy


def take_turns(what: str, jobs: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Seconds of each job in each round, after one round that doesn't count: drift of the machine hits all alike."""
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for counts in tqdm([False, *[True] * rounds], desc=what, disable=None, unit="round"):
        for name, job in jobs.items():
            begun = time.perf_counter()
            job()
            if counts:
                times[name].append(time.perf_counter() - begun)
    return times


def time_updates(recipes: Mapping[str, Recipe], rounds: int) -> dict[str, list[float]]:
    """Seconds of an update of each network, as the loop makes them, drawing the crops left out."""

    def job(recipe: Recipe) -> Callable[[], object]:
        run = Run(recipe)
        low = torch.rand(recipe.batch, 3, recipe.crop // recipe.scale, recipe.crop // recipe.scale)
        high = torch.rand(recipe.batch, 3, recipe.crop, recipe.crop)
        return lambda: float(run.update(low, high)["loss"])  # a GPU has finished when its loss is known

    return take_turns("updates", {name: job(recipe) for name, recipe in recipes.items()}, rounds)


def time_views(names: Sequence[str], rounds: int) -> dict[str, list[float]]:
    """Seconds of one view of `VIEW` x `VIEW` pixels through onnxruntime, or numpy for interpolation, on one core."""
    view = np.random.default_rng(0).random((1, 3, VIEW, VIEW), dtype=np.float32)

    def job(name: str) -> Callable[[], object]:
        if name in BASELINES:
            upscaler = BASELINES[name](SCALE)
            return lambda: upscaler(view)
        network = export.simplify_network(make_network(PEERS[name].network, PEERS[name].options).eval())
        session = open_session(to_onnx.convert_network(network, SCALE), 1)
        return lambda: session.run(None, {to_onnx.INPUT: view})

    return take_turns("views", {name: job(name) for name in names}, rounds)


def figures(name: str, scores: Sequence[Accuracy], updates: int) -> Figures:
    """A row without its times."""
    if name in BASELINES:
        return Figures(name, f"{name} interpolation", accuracy=tuple(scores))
    peer = PEERS[name]
    network = export.simplify_network(make_network(peer.network, peer.options).eval())
    multiply_adds = measure.count_macs(network, Sizes()) * 1280 * 720 / 1e9
    learnt = measure.count_parameters(network)
    return Figures(name, peer.label, tuple(scores), updates if scores else 0, learnt, multiply_adds)


def main(argv: list[str] | None = None) -> int:
    """Trains, scores and times the networks, and prints the tables."""
    parser = argparse.ArgumentParser(prog="benchmarks.peers", description=main.__doc__)
    parser.add_argument("--updates", type=int, default=1500, help="of each network (default 1500)")
    parser.add_argument("--crop", type=int, default=48, help="HR crop side, pixels (default 48)")
    parser.add_argument("--batch", type=int, default=16, help="crops an update (default 16)")
    parser.add_argument("--rounds", type=int, default=5, help="times that each update and view is timed (default 5)")
    parser.add_argument("--only", nargs="+", choices=[*BASELINES, *PEERS], help="rows (default: all)", metavar="NAME")
    parser.add_argument("--all", action="store_true", help="train RDN and ESRGAN's generator without a GPU too")
    parser.add_argument(
        "--data", type=Path, default=Path("../shared/data/images"), help="holds train and the test sets"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/peers"), help="default: runs/peers")
    given = parser.parse_args(argv)

    names = given.only or [*BASELINES, *PEERS]
    sets = [given.data / name for name in SETS]
    recipes = {
        name: recipe(name, updates=given.updates, crop=given.crop, batch=given.batch, data=given.data) for name in PEERS
    }
    rows: dict[str, Figures] = {}
    for name in names:
        scores: Sequence[Accuracy] = ()
        if name in BASELINES:
            scores = [score(BASELINES[name](SCALE), folder) for folder in sets]
        elif not PEERS[name].large or given.all or torch.cuda.is_available():
            sys.stderr.write(f"{name}: {given.updates} updates\n")
            try:
                scores = accuracy(name, train(recipes[name], given.out / name), sets)
            except Stopped as stop:
                parser.exit(128 + stop.number, f"{parser.prog}: {stop}\n")
            except (ValueError, FloatingPointError) as error:
                parser.exit(1, f"{parser.prog}: {name}: {error}\n")
        rows[name] = figures(name, scores, given.updates)

    trained = [name for name in names if name in PEERS]
    timed = {name: recipes[name] for name in dict.fromkeys([BASIS, *trained])} if trained else {}
    updates, views = time_updates(timed, given.rounds), time_views(names, given.rounds)
    for name in names:
        row = replace(rows[name], milliseconds=1000 * statistics.median(views[name]))
        if name in updates:
            ratios = [mine / basis for mine, basis in zip(updates[name], updates[BASIS], strict=True)]
            row = replace(row, seconds_per_update=statistics.median(updates[name]), ratio=statistics.median(ratios))
        rows[name] = row
    times = {"update_seconds": updates, "view_seconds": views}
    sys.stdout.write(peers_tables.write(given.out, rows, times, recipes[BASIS], table_2=TABLE_2, table_3=TABLE_3))
    return 0


if __name__ == "__main__":
    sys.exit(main())
