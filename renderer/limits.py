"""The most that an input may hold: one place for what the service lets people set."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Most of each; what a file says of itself is held against them before anything of that size is made."""

    files: int = 4096
    """Files in a folder or a zip."""
    bytes: int = 512 * 2**20
    """Bytes of one file, or of all files of a zip together, unpacked."""
    ratio: int = 250
    """Unpacked over packed bytes of a zip, looked at from 1 MiB unpacked up."""
    pixels: int = 64_000_000
    """Pixels in a picture; and in all textures of a mesh together, those that turn out to be corrupt among them."""
    set_bytes: int = 1_000_000_000
    """Bytes of all views of a set, decoded: 17 x 17 of 1024 x 1024 x 3 (Knights in full) come to 909 million."""
    triangles: int = 4_000_000
    """Triangles in a mesh, which may have three times as many vertices."""
    views: int = 65_536
    """Views in a set, and in an answer."""


DEFAULT_LIMITS = Limits()
"""Where nobody says anything else."""
