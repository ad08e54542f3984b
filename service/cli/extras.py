"""The extras that commands need: an installation without one names the remedy."""

from __future__ import annotations

import importlib
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Iterator

EXTRAS = {
    "batch": "batch",
    "serve": "service",
    "worker": "service",
    "bench": "bench",
    "evaluate": "training",
    "train": "training",
    "export": "training",
}
"""Command -> the extra of pyproject.toml that it needs."""
OF_PACKAGES = {"redis": "redis", "skimage": "bench", "torch": "training", "onnx": "training"}
"""Package -> the smallest extra that brings it, where that is not the command's."""

USED_LATE = {"bench": "matplotlib"}
"""Command -> a package that it first uses after minutes of work."""


@contextmanager
def require_extra(command: str) -> Iterator[None]:
    """Raises `InvalidOption` with the remedy where the block imports a package that is not installed."""
    try:
        if command in USED_LATE:
            importlib.import_module(USED_LATE[command])
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "ciir").partition(".")[0]
        if command not in EXTRAS or package == "ciir":
            raise
        extra = OF_PACKAGES.get(package, EXTRAS[command])
        raise InvalidOption(
            f"{command}: the package {package} is not installed; run pip install 'ciir[{extra}]'"
        ) from error
