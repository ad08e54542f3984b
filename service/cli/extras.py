"""The extras that commands need. If one is not installed, the error says how to install it."""

from __future__ import annotations

import importlib
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption, advise_extra

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
"""Package -> the smallest extra that installs it, if that is not the command's."""

USED_LATE = {"bench": ("matplotlib", "skimage"), "evaluate": ("skimage",), "train": ("skimage",)}
"""Command -> packages that it first imports after seconds or minutes of work."""


@contextmanager
def require_extra(command: str) -> Iterator[None]:
    """Raises `InvalidOption` with the remedy if the block imports a package that is not installed."""
    try:
        for package in USED_LATE.get(command, ()):
            importlib.import_module(package)
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "ciir").partition(".")[0]
        if command not in EXTRAS or package == "ciir":
            raise
        extra = OF_PACKAGES.get(package, EXTRAS[command])
        raise InvalidOption(f"{command}: the package {package} is not installed; run {advise_extra(extra)}") from error
