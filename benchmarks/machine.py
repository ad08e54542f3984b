"""Describes the machine and the versions that a measurement was made with."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from ciir.cores import count_available_cores
from ciir.models import processor

PACKAGES = ("ciir", "numpy", "onnxruntime", "embreex", "pyrender", "torch")


def describe() -> dict[str, Any]:
    """Returns processor, cores, system and versions; None for a package that is not installed."""
    return {
        "processor": processor.processor_name(),
        "cores": count_available_cores(),
        "int8": not processor.int8_unsupported_reason(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in PACKAGES},
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
