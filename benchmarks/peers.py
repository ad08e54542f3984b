"""Compares all networks at an equal budget, for the paper's table 2 (blocks, batch normalisation) and table 3 (other
networks).

    python -m ciir.benchmarks.peers [--updates 1500] [--crop 48] [--batch 16] [--only NAME ...] [--all] [--out DIR]

All are trained by `training.loop.train.train` on the same crops in the same order, with the same number of updates,
pixel loss and step sizes, and scored on the public sets after export. SRGAN's and ESRGAN's generators also have pixel
loss. Without a GPU, RDN and ESRGAN's generator are only timed, unless `--all` is given. An interrupted run resumes when
it is started again with the same options. `--out` gets a folder for each network (its checkpoint, log, ONNX file and
card), `tables.md`, and `figures.json` with every figure. Needs the training extra.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from ciir.benchmarks import machine
from ciir.benchmarks.bench.timing import Times, time_call, time_in_rounds
from ciir.benchmarks.others import SCALE, UntiledNetwork
from ciir.benchmarks.peer_tables import SETS, TEXT, Figures, format_rows
from ciir.models import cards
from ciir.models.cards import Sizes
from ciir.models.catalogue import BASELINES
from ciir.models.sessions import open_session
from ciir.training.evaluation.pictures import score
from ciir.training.export import export, measure, to_onnx
from ciir.training.loop import checkpoints
from ciir.training.loop.interrupt import Stopped
from ciir.training.loop.run import Run, find_commit
from ciir.training.loop.train import train
from ciir.training.networks import make_network
from ciir.training.recipe import Recipe

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from ciir.models.cards import Accuracy

LEARNING_RATE = 5e-4
"""Adam's peak step size for all networks: it is reached after a warm-up over a twentieth of the updates, then falls
along a half cosine to zero. Four times as much breaks the 16 blocks without batch normalisation."""
VIEW = 200
"""Side of the view whose upscaling is timed, in pixels."""


@dataclass(frozen=True)
class Peer:
    """A network that is trained, as a row of the tables."""

    label: str
    network: str
    options: dict[str, Any] = field(default_factory=dict)
    large: bool = False
    """Whether it is too slow to train on a few CPU cores, and its receptive field is too wide for tiles."""


BLOCKS = (3, 6, 16)
REFERENCE = "lite-6"
"""The paper's generator, with which the times of updates are compared."""
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
"""Name of the run -> the network that is trained."""
TABLE_2 = tuple(name for name in PEERS if name.startswith("lite-"))
TABLE_3 = (*BASELINES, *(name for name in PEERS if name not in TABLE_2 or name == REFERENCE))


def make_recipe(name: str, *, updates: int, crop: int, batch: int, data: Path) -> Recipe:
    """Returns the recipe of the network `name`. Everything except its design and options is the same for all."""
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


def measure_accuracy(name: str, checkpoint: Path, sets: Sequence[Path]) -> tuple[Accuracy, ...]:
    """Scores a finished run on `sets`, through its ONNX file and card, which stay next to the checkpoint."""
    if PEERS[name].large:
        network = export.simplify_network(export.load_network(checkpoints.read_checkpoint(checkpoint)))
        upscaler = UntiledNetwork(name, to_onnx.convert_network(network, SCALE))
        return tuple(score(upscaler, folder) for folder in sets)
    card = checkpoint.with_name(f"{name}.json")
    if not card.exists() or card.stat().st_mtime < checkpoint.stat().st_mtime:
        export.export_network(checkpoint, card.parent, accuracy_on=sets)
    return cards.read_card(card).accuracy


def time_updates(recipes: Mapping[str, Recipe], rounds: int) -> dict[str, Times]:
    """Times an update of each network as in training, without drawing the crops."""

    def prepare(recipe: Recipe) -> Callable[[], object]:
        run = Run(recipe)
        low = torch.rand(recipe.batch, 3, recipe.crop // recipe.scale, recipe.crop // recipe.scale)
        high = torch.rand(recipe.batch, 3, recipe.crop, recipe.crop)
        return lambda: float(run.update(low, high)["loss"])  # a GPU has finished when its loss is known

    jobs = {name: partial(time_call, prepare(recipe)) for name, recipe in recipes.items()}
    return time_in_rounds(jobs, rounds, reference=REFERENCE)


def time_views(names: Sequence[str], rounds: int) -> dict[str, Times]:
    """Times one view of `VIEW` x `VIEW` pixels with onnxruntime, or numpy for interpolation, on one core."""
    view = np.random.default_rng(0).random((1, 3, VIEW, VIEW), dtype=np.float32)

    def prepare(name: str) -> Callable[[], object]:
        if name in BASELINES:
            return partial(BASELINES[name](SCALE), view)
        network = export.simplify_network(make_network(PEERS[name].network, PEERS[name].options).eval())
        session = open_session(to_onnx.convert_network(network, SCALE), 1)
        return lambda: session.run(None, {to_onnx.INPUT: view})

    return time_in_rounds({name: partial(time_call, prepare(name)) for name in names}, rounds)


def describe_network(name: str, scores: Sequence[Accuracy], updates: int) -> Figures:
    """Returns a row without its times."""
    if name in BASELINES:
        return Figures(f"{name} interpolation", accuracy=tuple(scores))
    peer = PEERS[name]
    network = export.simplify_network(make_network(peer.network, peer.options).eval())
    multiply_adds = measure.count_macs(network, Sizes()) * 1280 * 720 / 1e9
    parameters = measure.count_parameters(network)
    return Figures(peer.label, tuple(scores), updates if scores else 0, parameters, multiply_adds)


def write_results(out: Path, rows: Mapping[str, Figures], recipe: Recipe) -> str:
    """Writes `tables.md` and `figures.json` into `out`, and returns the former."""
    here = machine.describe() | {
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        "threads": torch.get_num_threads(),
    }
    budget = {key: value for key, value in asdict(recipe).items() if key not in ("name", "network", "options")}
    networks = {name: asdict(row) for name, row in rows.items()}
    found = {"commit": find_commit(), "machine": here, "recipe": budget, "networks": networks}
    text = TEXT.format(
        table_2=format_rows([rows[name] for name in TABLE_2 if name in rows]),
        table_3=format_rows([rows[name] for name in TABLE_3 if name in rows]),
        recipe=recipe,
        commit=found["commit"],
        gpu=here["gpu"] or "none",
        **{key: here[key] for key in ("processor", "cores", "threads")},
    )
    out.mkdir(parents=True, exist_ok=True)
    (out / "tables.md").write_text(text, encoding="utf-8")
    (out / "figures.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return text


def main(argv: list[str] | None = None) -> int:
    """Trains, scores and times the networks, and prints the tables."""
    parser = argparse.ArgumentParser(prog="benchmarks.peers", description=main.__doc__)
    parser.add_argument("--updates", type=int, default=1500, help="updates of each network (default 1500)")
    parser.add_argument("--crop", type=int, default=48, help="HR crop side, pixels (default 48)")
    parser.add_argument("--batch", type=int, default=16, help="crops an update (default 16)")
    parser.add_argument("--rounds", type=int, default=5, help="times that each update and view is timed (default 5)")
    parser.add_argument("--only", nargs="+", choices=[*BASELINES, *PEERS], help="rows (default: all)", metavar="NAME")
    parser.add_argument("--all", action="store_true", help="train RDN and ESRGAN's generator without a GPU too")
    parser.add_argument(
        "--data", type=Path, default=Path("../shared/data/images"), help="folder with train and the test sets"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/peers"), help="default: runs/peers")
    args = parser.parse_args(argv)

    names = args.only or [*BASELINES, *PEERS]
    sets = [args.data / name for name in SETS]
    recipes = {
        name: make_recipe(name, updates=args.updates, crop=args.crop, batch=args.batch, data=args.data)
        for name in PEERS
    }
    rows: dict[str, Figures] = {}
    for name in names:
        scores: Sequence[Accuracy] = ()
        if name in BASELINES:
            scores = [score(BASELINES[name](SCALE), folder) for folder in sets]
        elif not PEERS[name].large or args.all or torch.cuda.is_available():
            sys.stderr.write(f"{name}: {args.updates} updates\n")
            try:
                scores = measure_accuracy(name, train(recipes[name], args.out / name), sets)
            except Stopped as stop:
                parser.exit(128 + stop.number, f"{parser.prog}: {stop}\n")
            except (ValueError, FloatingPointError) as error:
                parser.exit(1, f"{parser.prog}: {name}: {error}\n")
        rows[name] = describe_network(name, scores, args.updates)

    trained = [name for name in names if name in PEERS]
    timed = {name: recipes[name] for name in dict.fromkeys([REFERENCE, *trained])} if trained else {}
    updates, views = time_updates(timed, args.rounds), time_views(names, args.rounds)
    for name in names:
        rows[name] = replace(rows[name], milliseconds=views[name].median)
        if name in updates:
            seconds, ratio = updates[name].median / 1000, 1 / (updates[name].ratio or 1)
            rows[name] = replace(rows[name], seconds_per_update=seconds, ratio=ratio)
    print(write_results(args.out, rows, recipes[REFERENCE]), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
