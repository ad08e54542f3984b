"""Encodes JPEG with Pillow."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels

MAX_SIDE = 65_500
"""Most pixels along one side: libjpeg's own limit."""


def encode(pixels: Pixels, quality: int = 95) -> bytes:
    """Returns a JPEG of contiguous `(height, width)` or `(height, width, 2..4)` 8-bit pixels, with full chroma
    resolution; alpha is left out if it is opaque everywhere.

    Raises `InvalidOption` if JPEG can't hold the pixels.
    """
    if pixels.dtype == np.uint8 and pixels.ndim == 3 and pixels.shape[2] in (2, 4) and (pixels[..., -1] == 255).all():
        pixels = pixels[..., 0] if pixels.shape[2] == 2 else pixels[..., :3]
    if pixels.dtype != np.uint8 or (pixels.ndim == 3 and pixels.shape[2] != 3):
        channels = pixels.shape[2] if pixels.ndim == 3 else 1
        raise InvalidOption(
            f"picture: JPEG holds 8-bit grey or RGB without transparency, not {channels} channels of "
            f"{8 * pixels.itemsize} bit; name the file .png or .tif"
        )
    if max(pixels.shape[:2]) > MAX_SIDE:
        raise InvalidOption(
            f"picture: JPEG holds at most {MAX_SIDE} pixels along a side, not {pixels.shape[1]}x{pixels.shape[0]} "
            "(width x height); name the file .png or .tif"
        )
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=quality, subsampling=0)
    return file.getvalue()
