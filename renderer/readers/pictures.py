"""Decodes 8-bit and 16-bit pictures, and TIFFs of floating-point numbers, which become 16 bit.

Sizes are checked before anything of that size is allocated. Colour profiles and gamma are ignored: pixels are used as
stored (`metadata.colour_profiles` writes notes about this).
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from ciir.errors import InputError, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers.picture_sizes import find_format
from ciir.renderer.readers.registry import FORMATS, LYTRO_RAW, LYTRO_RAW_SIZES, PictureFormat

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.registry import PictureDecoder

Pixels: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]
"""`(height, width, channels)`; channels: 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha (not premultiplied)."""

PICTURES = tuple(entry for entry in FORMATS if isinstance(entry, PictureFormat))
SUFFIXES = frozenset(suffix for entry in PICTURES for suffix in entry.suffixes)
"""The suffixes of pictures that are read, in lower case."""
MAX_SIDE = 131_072
"""The most pixels along one side of a picture."""

# The raised error is enough: tifffile's log lines would be printed on standard error.
logging.getLogger("tifffile").addHandler(logging.NullHandler())


def decode(
    data: bytes,
    *,
    name: str,
    max_pixels: int = DEFAULT_LIMITS.pixels,
    check: Callable[[int, int], None] | None = None,
    other: PictureFormat | None = None,
) -> Pixels:
    """Returns a picture's pixels as stored, `(height, width, channels)`, 8 or 16 bit, turned as its orientation tag
    says. Floating-point pixels from 0 to 1 become 16 bit (`note_samples`).

    PNG's palettes, 1 to 4 bits and transparent colour are expanded. The array may be read-only. `name` is only for
    messages. `check(height, width)` is called before decoding and may raise an error of its own. `other` is the format
    if the picture is none of `PICTURES`.

    Raises `UnsupportedType` for other formats and other pixels, `TooLarge` over `max_pixels` (height x width) or
    `MAX_SIDE` or if memory runs out, and `Unreadable` if the picture is damaged or cut off.
    """

    def check_whole(height: int, width: int) -> None:
        check_size(height, width, name=name, max_pixels=max_pixels)
        if check is not None:
            check(height, width)

    found = find_format(data) or other or (LYTRO_RAW if len(data) in LYTRO_RAW_SIZES else None)
    if not data:
        raise Unreadable(f"{name}: the file is empty (0 bytes); give it again")
    if found is None:
        listed = ", ".join(entry.name for entry in PICTURES)
        raise UnsupportedType(f"{name}: not a picture that is read ({listed}, by its first bytes); convert it to PNG")
    decoder: PictureDecoder = found.load_reader()
    try:
        pixels, orientation = decoder(data, name, check_whole)
        pixels = _turn_upright(pixels if pixels.ndim == 3 else pixels[..., np.newaxis], orientation)
        return cast("Pixels", np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder("=")))
    except InputError:
        raise
    except MemoryError as error:
        raise TooLarge(f"{name}: decoding it takes more memory than there is; crop it or scale it down") from error
    except Exception as error:
        raise Unreadable(
            f"{name}: damaged or cut off (while the {found.name} picture was decoded); send the whole file"
        ) from error


def check_size(height: int, width: int, *, name: str, max_pixels: int = DEFAULT_LIMITS.pixels) -> None:
    """Raises `Unreadable` for a picture without pixels, `TooLarge` over `max_pixels` (height x width) or `MAX_SIDE`."""
    if height < 1 or width < 1:
        raise Unreadable(f"{name}: {height}x{width} pixels (rows x columns); send a picture with pixels in it")
    if height * width > max_pixels or max(height, width) > MAX_SIDE:
        raise TooLarge(
            f"{name}: {height}x{width} pixels (rows x columns) are over the limit of {max_pixels:,} in all "
            f"and {MAX_SIDE:,} along a side; crop it or scale it down",
            "pixels" if height * width > max_pixels else "",
        )


def note_samples(data: bytes) -> tuple[str, ...]:
    """Returns notes on the samples of the picture in `data`, which was decoded, as `tiff.note_page` does."""
    found = find_format(data)
    if found is None or found.name != "TIFF":
        return ()
    from ciir.renderer.readers import tiff

    return tiff.note_samples(data)


def _turn_upright(pixels: Pixels, orientation: int) -> Pixels:
    """Undoes the orientations 1 to 8 of Exif and TIFF 6.0."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels
