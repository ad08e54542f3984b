"""Limits on the size of inputs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """The most that an input may hold; sizes stated in a file are checked before memory of that size is allocated."""

    files: int = 4096
    """Files in a folder or a zip."""
    bytes: int = 512 * 2**20
    """Bytes of one file, or of all files of an uploaded zip, unpacked."""
    ratio: int = 250
    """Unpacked over packed bytes of a zip, checked from 1 MiB unpacked."""
    pixels: int = 2**26
    """Pixels in a picture, 8192x8192, and in all textures of a mesh: each texture is scaled down to half of what is
    left."""
    set_bytes: int = 1_000_000_000
    """Bytes of all views of a set, decoded: 17 x 17 of 1024 x 1024 x 3 (Knights in full) are 909 million."""
    triangles: int = 4_000_000
    """Triangles in a mesh, which may have three times as many vertices."""
    views: int = 65_536
    """Views in a set, and in a result."""


DEFAULT_LIMITS = Limits()
