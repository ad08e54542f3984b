"""Decodes uncompressed BMP with Pillow: 8-bit grey, RGB and RGBA."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

# Image.open is not used: it would try other decoders and warn about large pictures.
from PIL.BmpImagePlugin import BmpImageFile

from ciir.errors import UnsupportedType

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Returns the pixels (palettes become RGB, and black and white becomes grey), and the orientation, which is always
    1. Raises `UnsupportedType` for run lengths, which Pillow decodes in Python.
    """
    with BmpImageFile(io.BytesIO(data)) as image:
        check_size(image.height, image.width)
        if image.tile[0][0] != "raw":
            raise UnsupportedType(f"{name}: a run-length encoded BMP; save it uncompressed, or as PNG")
        mode = {"1": "L", "P": "RGB"}.get(image.mode, image.mode)
        return np.asarray(image.convert(mode)), 1
