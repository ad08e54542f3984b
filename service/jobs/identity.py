"""The id of a request: a hash of everything that its result depends on. Nothing is decoded."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ciir.models import catalogue
from ciir.service.pipeline.options import KINDS, NAMES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ciir.service.jobs.job import Request

DIGITS = 32
_PACKAGES = (
    "ciir",
    "numpy",
    "onnxruntime",
    "embreex",
    "pyrender",
    "pillow",
    "imagecodecs",
    "tifffile",
    "av",
    "h5py",
    "scipy",
    "DracoPy",
    "trimesh",
    "pycollada",
    "opengl-basisu",  # optional
)
_CODE = ("renderer", "models", "service")
_SUFFIXES = (".py", ".json", ".frag", ".vert")


def compute_id(request: Request, content: str, limits: Mapping[str, Any]) -> str:
    """Computes the id of a request, `DIGITS` hexadecimal digits.

    It is a hash of the file's SHA-256 `content`, the name, the options, the kind, the format, the limits and the
    installation. Options are parsed first, so that giving an option's default and leaving it out give the same id.
    """
    inputs = [
        hash_installation(),
        request.name,
        KINDS[request.kind].parse(request.options).as_dict(NAMES),
        request.kind,
        request.format,
        dict(limits),
        content,
    ]
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()[:DIGITS]


def compute_file_id(name: str, content: str) -> str:
    """Computes the id of a kept file with that name and SHA-256. It is the same for all versions."""
    return hashlib.sha256(json.dumps([name, content]).encode()).hexdigest()[:DIGITS]


@cache
def hash_installation() -> str:
    """Hashes the code, the cards (which hold the networks' SHA-256), the shaders and the versions of dependencies."""
    digest = hashlib.sha256(json.dumps([(name, _find_version(name)) for name in _PACKAGES]).encode())
    root = Path(__file__).parents[2]
    for folder in _CODE:
        for path in sorted(path for path in (root / folder).rglob("*") if path.suffix in _SUFFIXES):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    for entry in catalogue.list_entries():
        if entry.path is not None:  # includes the user's own models, wherever they are
            digest.update(entry.path.read_bytes() + b"\0")
    return digest.hexdigest()


def _find_version(package: str) -> str:
    """Returns the version of a package; empty if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
