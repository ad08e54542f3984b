"""Encodes TIFF: one page of 8 or 16 bit grey or RGB, with or without alpha (TIFF 6.0)."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import tifffile

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels


def encode(pixels: Pixels, ppi: float | None = None) -> bytes:
    """Returns a TIFF (deflate, horizontal differences) of contiguous `(height, width)` or `(height, width, 2..4)`
    pixels, with a resolution of `ppi` pixels per inch.
    """
    file = io.BytesIO()
    size: dict[str, Any] = {} if ppi is None else {"resolution": (ppi, ppi), "resolutionunit": "INCH"}
    tifffile.imwrite(file, pixels, **describe_page(pixels.shape[2] if pixels.ndim == 3 else 1), **size)
    return file.getvalue()


def describe_page(channels: int) -> dict[str, Any]:
    """Returns the arguments for tifffile to write a page of 1 to 4 channels: lossless, and without tags of its own."""
    colours = 3 if channels >= 3 else 1
    return {
        "photometric": "rgb" if colours == 3 else "minisblack",
        "planarconfig": "contig" if channels > 1 else None,
        "extrasamples": ["unassalpha"] if channels > colours else None,
        "compression": "deflate",
        "predictor": True,
        "metadata": None,
        "software": False,
    }
