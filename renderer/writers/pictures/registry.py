"""The registry of picture formats that can be written.

A new format is a module next to this one with `encode(pixels) -> bytes`, and its line in `FORMATS`. If the format has
limits that `encode` finds only in complete pictures, the module also has `check(size, dtype)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.writers.file_types import FileType, index_suffixes

if TYPE_CHECKING:
    from collections.abc import Mapping
    from types import ModuleType

    from ciir.renderer.readers.pictures import Pixels


@dataclass(frozen=True)
class PictureFormat(FileType):
    """A format of single pictures, in the module of its name."""

    takes: tuple[str, ...] = ()
    """What else its `encode` takes: `text` by keyword, and `ppi`, a resolution in pixels per inch."""
    is_lossless: bool = True
    """Whether it keeps every pixel."""

    def encode(self, pixels: Pixels, text: Mapping[str, str] | None = None, ppi: float | None = None) -> bytes:
        """Returns the file with `pixels`, `(height, width, 1..4)`, 8 or 16 bit, with `text` and `ppi` if the format
        `takes` them.

        Raises `InvalidOption` if the format can't hold them. The encoder is imported when it is first needed.
        """
        squeezed = pixels[..., 0] if pixels.shape[2] == 1 else pixels
        given = {"text": text or None, "ppi": ppi}
        extra = {name: given[name] for name in self.takes if given[name] is not None}
        return cast("bytes", self._load().encode(np.ascontiguousarray(squeezed), **extra))

    def check(self, size: tuple[int, int], dtype: np.dtype[Any]) -> None:
        """Raises `InvalidOption` if the format's module has a `check` and refuses `size` pixels, height and width, of
        that type; other formats raise in `encode`.
        """
        if (check := getattr(self._load(), "check", None)) is not None:
            check(size, dtype)

    def _load(self) -> ModuleType:
        return import_module(f"ciir.renderer.writers.pictures.{self.name}")


FORMATS = {
    entry.name: entry
    for entry in (
        PictureFormat("png", (".png",), "image/png", takes=("text", "ppi")),
        PictureFormat("tiff", (".tif", ".tiff"), "image/tiff", takes=("ppi",)),
        PictureFormat("jpeg", (".jpg", ".jpeg"), "image/jpeg", is_lossless=False),
        PictureFormat("webp", (".webp",), "image/webp"),
    )
}
"""The formats by name."""
BY_SUFFIX = index_suffixes(FORMATS.values())
SUFFIXES = tuple(BY_SUFFIX)
"""Suffixes of picture files that can be written, in lower case."""


def encode(pixels: Pixels, suffix: str, text: Mapping[str, str] | None = None, *, ppi: float | None = None) -> bytes:
    """Returns the file that a name ending with `suffix` asks for, of `(height, width, 1..4)` pixels, 8 or 16 bit; a PNG
    also has `text`, by keyword, and PNG and TIFF state a resolution of `ppi` pixels per inch.

    PNG and TIFF keep every bit. JPEG is written at quality 95 without chroma subsampling.

    Raises `InvalidOption` for another suffix, or if the format can't hold the pixels.
    """
    entry = BY_SUFFIX.get(suffix.lower())
    if entry is None:
        raise InvalidOption(f"picture: {suffix!r} can't be written; end the name with {', '.join(SUFFIXES)}")
    return entry.encode(pixels, text, ppi)


def encode_png(pixels: Pixels, text: Mapping[str, str] | None = None, *, ppi: float | None = None) -> bytes:
    """Returns a PNG of `(height, width, 1..4)` pixels, 8 or 16 bit, every bit kept, with `text` by keyword."""
    return BY_SUFFIX[".png"].encode(pixels, text, ppi)
