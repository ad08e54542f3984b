"""Reads a picture as an elemental image array."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures

if TYPE_CHECKING:
    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout


def read_eia(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """The light field of the elemental image array in the picture `data`: `layout.lenses` say how many elemental images
    it has, or `layout.pixels` how large they are.

    Raises `InvalidOption` where both are missing or don't fit the picture, and as `pictures.decode`.
    """
    lenses, pixels = layout.lenses, layout.pixels
    if lenses is None and pixels is None:
        raise InvalidOption(
            f"{name}: a picture is read as an elemental image array; give the number of lenses, "
            "as in lenses 50x50 (rows x columns), or of pixels of each, as in pixels 15x15"
        )
    eia = pictures.decode(data, name=name, max_pixels=limits.pixels)
    height, width = eia.shape[:2]
    if pixels is not None and (min(pixels) < 1 or height % pixels[0] or width % pixels[1]):
        raise InvalidOption(
            f"pixels: {pixels[0]}x{pixels[1]} does not divide the picture of {height}x{width} pixels (rows x columns); "
            "give the size of one elemental image, or crop the picture to whole ones"
        )
    counted = None if pixels is None else (height // pixels[0], width // pixels[1])
    rows, cols = lenses or counted or (0, 0)
    if pixels is not None and counted != (rows, cols):
        raise InvalidOption(
            f"lenses, pixels: {rows}x{cols} lenses of {pixels[0]}x{pixels[1]} pixels do not make the picture of "
            f"{height}x{width} pixels; give one of the two options alone"
        )
    return LightField.from_eia(eia, rows=rows, cols=cols, pickup=layout.pickup)
