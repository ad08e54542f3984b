"""White and dark frames, which correct a raw lenslet picture for its lenses and its sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.readers.lenslet.signals import scale_luma

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels

MOST_GAIN = 10.0
"""The largest gain. Darker parts of lenses are not brightened further, because that would show noise."""


def subtract_dark(picture: Pixels, dark: Pixels) -> Pixels:
    """Returns `picture` minus `dark`, both `(H, W, C)` of the same type, not below 0. Alpha stays as it is."""
    less: Pixels = picture - np.minimum(picture, dark)
    if picture.shape[2] in (2, 4):
        less[..., -1] = picture[..., -1]
    return less


def divide_by_white(picture: Pixels, white: Pixels) -> Pixels:
    """Returns `picture` as if all of it were as bright as the middle of the brightest lenses of `white`, both
    `(H, W, C)`.

    Colours are kept, because the gain of a pixel is the same in all channels. Alpha stays as it is.
    """
    gain = np.clip(255 / np.maximum(scale_luma(white), 1), 1, MOST_GAIN)
    colours = picture.shape[2] - (picture.shape[2] in (2, 4))
    flat: Pixels = picture.copy()
    for channel in range(colours):
        flat[..., channel] = np.rint(np.minimum(picture[..., channel] * gain, np.iinfo(picture.dtype).max))
    return flat
