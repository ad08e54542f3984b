"""Checkpoints: written whole or not at all, read with a word on what is wrong."""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING, Any

import torch

if TYPE_CHECKING:
    from pathlib import Path

KEYS = frozenset({"network", "optimiser", "step", "recipe", "commit", "seconds"})


def save(path: Path, state: dict[str, Any]) -> None:
    """Writes a checkpoint, `KEYS` and more, whole or not at all."""
    partial = path.with_suffix(".partial")
    torch.save(state, partial)
    partial.replace(path)


def read(path: Path) -> dict[str, Any]:
    """The checkpoint in `path`, tensors on the CPU. Raises `ValueError` where it is none."""
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, pickle.UnpicklingError, EOFError, ValueError, LookupError, TypeError) as error:
        raise ValueError(f"{path}: not a checkpoint; give the checkpoint.pt that `ciir train` wrote") from error
    if not isinstance(state, dict) or not state.keys() >= KEYS:
        raise ValueError(f"{path}: not a checkpoint of `ciir train`; give the checkpoint.pt that it wrote")
    return state
