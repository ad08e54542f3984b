"""Which requests are the same: an id for everything that a result depends on and that needs no decoding."""

from __future__ import annotations

import hashlib
import json
import os
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ciir.service.pipeline.options import Options

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ciir.service.jobs.job import Request

DIGITS = 32
CHUNK = 1 << 20
_PACKAGES = ("ciir", "numpy", "onnxruntime", "embreex", "pyrender", "pillow", "imagecodecs", "tifffile", "DracoPy")
_CODE = ("renderer", "models", "service")
_SUFFIXES = (".py", ".json", ".frag", ".vert")


def identity(request: Request, file: BinaryIO, limits: Mapping[str, int]) -> str:
    """`DIGITS` hexadecimal digits: the hash of the input's bytes, the suffix of its name, the options, the format, the
    limits in force, and the installation, which holds the networks' SHA-256 and all versions.

    Options are hashed as they are meant: `50X50` is `50x50`, and one that is given as its default isn't given. `file`
    is read from its beginning and left there.
    """
    asked = [
        installation(),
        os.path.splitext(request.name)[1],  # noqa: PTH122 - a name, no path
        Options.parse(request.options).as_dict(),
        request.format,
        dict(limits),
    ]
    digest = hashlib.sha256(json.dumps(asked, sort_keys=True).encode() + b"\0")
    file.seek(0)
    while chunk := file.read(CHUNK):
        digest.update(chunk)
    file.seek(0)
    return digest.hexdigest()[:DIGITS]


@cache
def installation() -> str:
    """Hash of this package's code, cards and shaders and of its dependencies' versions; takes some 10 ms once."""
    digest = hashlib.sha256(json.dumps([(name, version(name)) for name in _PACKAGES]).encode())
    root = Path(__file__).parents[2]
    for folder in _CODE:
        for path in sorted(path for path in (root / folder).rglob("*") if path.suffix in _SUFFIXES):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()
