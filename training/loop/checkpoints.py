"""Writes and reads checkpoints of training runs: atomically, and with clear errors."""

from __future__ import annotations

import io
import os
import pickle
from typing import TYPE_CHECKING, Any

import torch

from ciir.renderer.writers.atomic_write import replacing

if TYPE_CHECKING:
    from pathlib import Path

KEYS = frozenset({"network", "optimiser", "step", "recipe", "commit", "seconds"})
"""The keys that every checkpoint has. Newer ones also have `raw`, `psnr` and `objective`."""


def save_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Writes a checkpoint, which has at least `KEYS`, atomically.

    Raises `FloatingPointError` if a tensor in it is not finite, and `OSError` if the disk is full. An existing file at
    `path` is then kept.
    """
    if not _is_finite(state):
        raise FloatingPointError(f"step {state['step']}: a weight is not a number; lower learning_rate or set clip")
    buffer = io.BytesIO()  # torch.save reports a full disk as an error in its own archive
    torch.save(state, buffer)
    with replacing(path) as file:
        file.write(buffer.getvalue())
        file.flush()
        os.fsync(file.fileno())  # otherwise a power cut could leave the new name on an empty file


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Reads a checkpoint, with its tensors on the CPU. Raises `ValueError` if the file is not one."""
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}; give the checkpoint.pt that `ciir train` wrote") from error
    except (RuntimeError, pickle.UnpicklingError, EOFError, ValueError, LookupError, TypeError) as error:
        raise ValueError(f"{path}: not a checkpoint; give the checkpoint.pt that `ciir train` wrote") from error
    if not isinstance(state, dict) or not state.keys() >= KEYS:
        raise ValueError(f"{path}: not a checkpoint of `ciir train`; give the checkpoint.pt that it wrote")
    return state


def _is_finite(value: Any) -> bool:
    if isinstance(value, torch.Tensor):
        return bool(torch.isfinite(value).all())
    if isinstance(value, dict):
        return all(_is_finite(part) for part in value.values())
    if isinstance(value, (list, tuple)):
        return all(_is_finite(part) for part in value)
    return True
