"""Encodes lossless WebP with Pillow."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels

MAX_SIDE = 16_383
"""Most pixels along one side: the format's own limit."""


def check(size: tuple[int, int], dtype: np.dtype[Any]) -> None:
    """Raises `InvalidOption` if WebP can't hold `size` pixels, height and width, of that type."""
    if dtype != np.uint8 or max(size) > MAX_SIDE:
        raise InvalidOption(
            f"picture: WebP holds 8 bit and {MAX_SIDE} pixels along a side, not {8 * dtype.itemsize} bit and "
            f"{size[1]}x{size[0]} (width x height); name the file .png or .tif"
        )


def encode(pixels: Pixels) -> bytes:
    """Returns a lossless WebP of contiguous 8-bit pixels `(height, width)` or `(height, width, 2..4)`; grey becomes
    RGB.

    Raises `InvalidOption` if WebP can't hold the pixels.
    """
    check(pixels.shape[:2], pixels.dtype)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", lossless=True, exact=True)  # exact: colours under alpha 0 stay
    return file.getvalue()
