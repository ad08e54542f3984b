"""The registry of picture formats that can be written.

A new format is a module next to this one with `encode(pixels) -> bytes`, and its line in `FORMATS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ciir.renderer.readers.pictures import Pixels


@dataclass(frozen=True)
class PictureFormat:
    """A format of single pictures."""

    name: str
    """Name of the format and of the module with its `encode`."""
    suffixes: tuple[str, ...]
    """Suffixes of file names, in lower case; the first is the usual one."""
    media_type: str

    def encode(self, pixels: Pixels, text: Mapping[str, str] | None = None, ppi: float | None = None) -> bytes:
        """Returns the file with `pixels`, `(height, width, 1..4)`, 8 or 16 bit; a PNG also gets `text`, by keyword, and
        a PNG or TIFF a resolution of `ppi` pixels per inch.

        Raises `InvalidOption` if the format can't hold them. The encoder is imported when it is first needed.
        """
        squeezed = pixels[..., 0] if pixels.shape[2] == 1 else pixels
        encoder = import_module(f"ciir.renderer.writers.pictures.{self.name}").encode
        extra: dict[str, object] = {"text": text} if text and self.name == "png" else {}
        if ppi is not None and self.name in ("png", "tiff"):
            extra["ppi"] = ppi
        return cast("bytes", encoder(np.ascontiguousarray(squeezed), **extra))

    def check(self, size: tuple[int, int], dtype: np.dtype[Any]) -> None:
        """Raises `InvalidOption` if WebP can't hold `size` pixels, height and width, of that type; other formats raise
        in `encode`.
        """
        if self.name == "webp":
            from ciir.renderer.writers.pictures import webp

            webp.check(size, dtype)


FORMATS = (
    PictureFormat("png", (".png",), "image/png"),
    PictureFormat("tiff", (".tif", ".tiff"), "image/tiff"),
    PictureFormat("jpeg", (".jpg", ".jpeg"), "image/jpeg"),
    PictureFormat("webp", (".webp",), "image/webp"),
)
BY_SUFFIX = {suffix: entry for entry in FORMATS for suffix in entry.suffixes}
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
