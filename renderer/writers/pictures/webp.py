"""Encodes WebP, lossless, by Pillow."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels

MAX_SIDE = 16_383
"""Most pixels along one side: the format's own limit."""


def encode(pixels: Pixels) -> bytes:
    """A lossless WebP of contiguous `(height, width)` or `(height, width, 2..4)` 8-bit pixels; grey becomes RGB.

    Raises `InvalidOption` where WebP can't hold the pixels.
    """
    if pixels.dtype != np.uint8 or max(pixels.shape[:2]) > MAX_SIDE:
        raise InvalidOption(
            f"picture: WebP holds 8 bit and {MAX_SIDE} pixels along a side, not {8 * pixels.itemsize} bit and "
            f"{pixels.shape[0]}x{pixels.shape[1]}; name the file .png or .tif"
        )
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", lossless=True, exact=True)  # exact: colours under alpha 0 stay
    return file.getvalue()
