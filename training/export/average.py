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
from torch.nn import functional

from ciir.training.loop import checkpoints

if TYPE_CHECKING:
    from collections.abc import Sequence


BRANCHES = ("widen", "narrow", "point")
"""The parameters of a `networks.collapsible.CollapsibleConv` whose products and sums are added to its plain kernel."""


def average_checkpoints(paths: Sequence[Path], out: Path) -> None:
    """Writes a checkpoint with the mean of the networks of `paths`.

    The mean is taken for each convolution, with all its branches added up. Everything else is from the first network.
    The recipe lists the paths under `averaged`. The checkpoint can be exported and started from, but not resumed.

    Raises `ValueError` if there are fewer than two paths, one is not a checkpoint, or their networks differ.
    """
    if len(paths) < 2:
        raise ValueError(f"{len(paths)} checkpoint given; give two or more")
    states = [checkpoints.read_checkpoint(path) for path in paths]
    first = states[0]
    for path, state in zip(paths[1:], states[1:], strict=True):
        designs = [(of["recipe"]["network"], of["recipe"]["options"]) for of in (first, state)]
        if designs[0] != designs[1]:
            raise ValueError(f"{path}: holds {designs[1]}, but {paths[0]} holds {designs[0]}; give runs of one network")
    networks = [state["network"] for state in states]
    mean = {key: _mean([network[key] for network in networks]) for key in first["network"]}
    for name in [key.removesuffix("widen") for key in mean if key.endswith(".widen")]:
        # Branches are products, so the first network's branches are kept and the plain kernel makes up the difference.
        kernels, branches = zip(*(_split_kernel(network, name) for network in networks), strict=True)
        mean |= {name + key: networks[0][name + key] for key in BRANCHES}
        mean[name + "kernel"] = _mean([one + rest for one, rest in zip(kernels, branches, strict=True)]) - branches[0]
    recipe: dict[str, Any] = {**first["recipe"], "averaged": [path.as_posix() for path in paths]}
    out.parent.mkdir(parents=True, exist_ok=True)
    checkpoints.save_checkpoint(out, {**first, "network": mean, "raw": mean, "recipe": recipe})


def _split_kernel(network: dict[str, torch.Tensor], name: str) -> tuple[torch.Tensor, torch.Tensor]:
    """Returns the plain kernel of the `CollapsibleConv` of this name, and the sum of its other branches without the
    identity.
    """
    widen, narrow, point = (network[name + key] for key in BRANCHES)
    centre = functional.pad(point[..., None, None], (1, 1, 1, 1))
    return network[name + "kernel"], torch.einsum("ow,wiyx->oiyx", narrow, widen) + centre


def _mean(tensors: Sequence[torch.Tensor]) -> torch.Tensor:
    """Returns the mean in the type of the first; integers (counts of a normalisation) are taken from the first."""
    if not tensors[0].is_floating_point():
        return tensors[0]
    return torch.stack([tensor.double() for tensor in tensors]).mean(0).to(tensors[0].dtype)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line."""
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
