"""Upscaling of view images: the shipped networks, a card for each, and code to run them on the CPU with onnxruntime.

::

    upscaler = models.load_upscaler("fast")
    large = models.upscale_pixels(upscaler, views)     # (N, H, W, C) 8 or 16 bit -> (N, 2H, 2W, C)
"""

from __future__ import annotations

from ciir.models.catalogue import (
    Entry,
    list_entries,
    list_names,
    load_upscaler,
    picture_default_name,
)
from ciir.models.single.pixels import upscale_pixels
from ciir.models.upscaler import Upscaler

__all__ = [
    "Entry",
    "Upscaler",
    "list_entries",
    "list_names",
    "load_upscaler",
    "picture_default_name",
    "upscale_pixels",
]
