"""The folder in which the service keeps its jobs by default."""

from __future__ import annotations

import os
from pathlib import Path

NAME = "CIIR_CACHE"
"""The environment variable that names the folder."""


def folder() -> Path | None:
    """Returns `CIIR_CACHE`, else `ciir` in `XDG_CACHE_HOME`, else in `~/.cache`; None for a process without a home."""
    if given := os.environ.get(NAME):
        return Path(given)
    if given := os.environ.get("XDG_CACHE_HOME"):
        return Path(given) / "ciir"
    try:
        return Path.home() / ".cache" / "ciir"
    except RuntimeError:
        return None
