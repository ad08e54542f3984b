"""Averages the weights of several checkpoints.

    python -m ciir.training.export.average CHECKPOINT CHECKPOINT... -o MEAN

Stochastic weight averaging (Izmailov et al., UAI 2018) and model soups (Wortsman et al., ICML 2022).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from ciir.training.loop import checkpoints

if TYPE_CHECKING:
    from collections.abc import Sequence


def average_checkpoints(paths: Sequence[Path], out: Path) -> None:
    """Writes a checkpoint with the mean of the networks of `paths`; everything else is from the first.

    Its recipe lists them under `averaged`: it can be exported and started from, but not resumed.
    Raises `ValueError` where there are fewer than two, one is not a checkpoint, or their networks differ.
    """
    if len(paths) < 2:
        raise ValueError(f"{len(paths)} checkpoint given; give two or more")
    states = [checkpoints.read_checkpoint(path) for path in paths]
    first = states[0]
    for path, state in zip(paths[1:], states[1:], strict=True):
        designs = [(of["recipe"]["network"], of["recipe"]["options"]) for of in (first, state)]
        if designs[0] != designs[1]:
            raise ValueError(f"{path}: holds {designs[1]}, and {paths[0]} {designs[0]}; give runs of one network")
    mean = {key: _mean([state["network"][key] for state in states]) for key in first["network"]}
    recipe: dict[str, Any] = {**first["recipe"], "averaged": [path.as_posix() for path in paths]}
    out.parent.mkdir(parents=True, exist_ok=True)
    checkpoints.save_checkpoint(out, {**first, "network": mean, "raw": mean, "recipe": recipe})


def _mean(tensors: Sequence[torch.Tensor]) -> torch.Tensor:
    """The mean in the type of the first; integers (counts of a normalisation) are taken from the first."""
    if not tensors[0].is_floating_point():
        return tensors[0]
    return torch.stack([tensor.double() for tensor in tensors]).mean(0).to(tensors[0].dtype)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("checkpoints", type=Path, nargs="+", metavar="CHECKPOINT")
    parser.add_argument("-o", "--out", type=Path, required=True, help="checkpoint to write")
    given = parser.parse_args(arguments)
    try:
        average_checkpoints(given.checkpoints, given.out)
    except (ValueError, FloatingPointError) as error:
        sys.exit(f"average: {error}")


if __name__ == "__main__":
    main()
