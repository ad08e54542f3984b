"""Compares ONNX networks of others with ours: accuracy on the public sets, and run time in turns in one run.

    python -m ciir.benchmarks.others NETWORK.onnx... [--sets FOLDER ...] [--models NAME|CARD ...] [--rounds 9]

A network of others takes RGB `(1, 3, H, W)` in [0, 1] and returns `(1, 3, 2*H, 2*W)`. Each network upscales a picture
of noise once in each round. Its time is that of the quickest round, and ratios to the first named network are taken
within rounds. The scores need the training extra.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.bench.tables import format_table
from ciir.benchmarks.bench.timing import time_call
from ciir.cores import count_available_cores
from ciir.models import catalogue
from ciir.models.sessions import open_session
from ciir.models.upscaler import clip_output
from ciir.training.evaluation.pictures import load_model, score

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ciir.models.upscaler import Upscaler

SCALE = 2
SETS = tuple(Path("../shared/data/images") / name for name in ("Set5", "Set14", "BSD100"))


class UntiledNetwork:
    """An ONNX network as an `Upscaler` without tiles: its receptive field is unknown, or too wide for them."""

    scale, radius = SCALE, 0

    def __init__(self, name: str, network: bytes) -> None:
        self.name = name
        self._session = open_session(network, threads=count_available_cores())
        self._input = self._session.get_inputs()[0].name

    def __call__(self, images: NDArray[np.float32]) -> NDArray[np.float32]:
        """See `Upscaler.__call__`."""
        made = [self._session.run(None, {self._input: images[i : i + 1]})[0] for i in range(len(images))]
        return clip_output(np.concatenate(made), self.name)


def compare(networks: Sequence[Upscaler], sets: Sequence[Path], *, rounds: int, side: int) -> list[str]:
    """Returns a Markdown table of all networks, the quickest first."""
    picture = np.random.default_rng(0).random((1, 3, side, side), np.float32)
    jobs = [partial(time_call, partial(network, picture)) for network in networks]
    times = np.array([[job()["total"] for job in jobs] for _ in range(rounds + 1)][1:])  # (rounds, networks)
    ratios = np.median(times / times[:, :1], axis=0)
    rows = []
    for place in np.argsort(times.min(axis=0)):
        scores = [f"{score(networks[place], folder).psnr:.2f}" for folder in sets]
        rows.append([f"`{networks[place].name}`", *scores, f"{times[:, place].min():.1f}", f"{ratios[place]:.2f}"])
    head = ["network", *(folder.name for folder in sets), f"ms, {side}x{side}", f"time / {networks[0].name}"]
    return format_table(head, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("networks", type=Path, nargs="+", metavar="NETWORK.onnx")
    parser.add_argument(
        "--models", nargs="*", help="names in the catalogue, or cards (default: all single-picture networks)"
    )
    parser.add_argument("--sets", type=Path, nargs="*", default=SETS, help="folders of *_LR.png and *_HR.png")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--side", type=int, default=256, help="pixels along each side of the picture that is timed")
    given = parser.parse_args(arguments)
    for path in (*given.networks, *given.sets):
        if not path.exists():
            parser.error(f"{path}: not found; name ONNX files, and with --sets folders of picture pairs")
    names = given.models or [name for name in catalogue.list_single_image_names() if name not in catalogue.BASELINES]
    networks: list[Upscaler] = [*(UntiledNetwork(path.stem, path.read_bytes()) for path in given.networks)]
    networks += map(load_model, names)
    print("\n".join(compare(networks, given.sets, rounds=given.rounds, side=given.side)))


if __name__ == "__main__":
    main()
