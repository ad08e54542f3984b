"""Checkpoints: written whole or not at all, read with a word on what is wrong."""

from __future__ import annotations

import io
import pickle
from typing import TYPE_CHECKING, Any

import torch

from ciir.training import atomic_write

if TYPE_CHECKING:
    from pathlib import Path

KEYS = frozenset({"network", "optimiser", "step", "recipe", "commit", "seconds"})
"""What every checkpoint has. Since there is a running mean: `raw` too, and `psnr`; since there are adversaries:
`objective`."""


def save_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Writes a checkpoint, `KEYS` and more, whole or not at all.

    Raises `FloatingPointError` where a tensor in it is not finite, and `OSError` where there is no room: what was in
    `path` stands.
    """
    if not _finite(state):
        raise FloatingPointError(f"step {state['step']}: a weight is not a number; lower learning_rate or set clip")
    buffer = io.BytesIO()  # torch tells of a full disk only as an error in its own archive
    torch.save(state, buffer)
    atomic_write.write(path, buffer.getvalue())


def read_checkpoint(path: Path) -> dict[str, Any]:
    """The checkpoint in `path`, tensors on the CPU. Raises `ValueError` where it is none."""
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}; give the checkpoint.pt that `ciir train` wrote") from error
    except (RuntimeError, pickle.UnpicklingError, EOFError, ValueError, LookupError, TypeError) as error:
        raise ValueError(f"{path}: not a checkpoint; give the checkpoint.pt that `ciir train` wrote") from error
    if not isinstance(state, dict) or not state.keys() >= KEYS:
        raise ValueError(f"{path}: not a checkpoint of `ciir train`; give the checkpoint.pt that it wrote")
    return state


def _finite(value: Any) -> bool:
    if isinstance(value, torch.Tensor):
        return bool(torch.isfinite(value).all())
    if isinstance(value, dict):
        return all(_finite(part) for part in value.values())
    if isinstance(value, (list, tuple)):
        return all(_finite(part) for part in value)
    return True
