"""Decodes TIFF: one page of 8-bit, 16-bit or floating-point grey or RGB, with or without alpha (TIFF 6.0 and BigTIFF).

Floating-point samples, from 0 to 1, are rounded to 16 bit.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
import tifffile

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.levels import ROUNDED, round_samples
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels

ORIENTATION = 274
PROFILE = 34675
COLOURS: dict[int, int] = {
    tifffile.PHOTOMETRIC.MINISBLACK: 1,
    tifffile.PHOTOMETRIC.MINISWHITE: 1,
    tifffile.PHOTOMETRIC.RGB: 3,
}
"""The colour spaces that are read, with their number of channels without alpha."""
BITS: dict[int, tuple[int, ...]] = {
    tifffile.SAMPLEFORMAT.UINT: (8, 16),
    tifffile.SAMPLEFORMAT.IEEEFP: (16, 32, 64),
}
"""The kinds of samples that are read, with their numbers of bits."""
COMPRESSIONS: tuple[int, ...] = (
    tifffile.COMPRESSION.NONE,
    tifffile.COMPRESSION.LZW,
    tifffile.COMPRESSION.ADOBE_DEFLATE,
    tifffile.COMPRESSION.DEFLATE,
    tifffile.COMPRESSION.PACKBITS,
)

UNSTATED = "the TIFF doesn't state what its last channel is, and it is taken as alpha; remove it if it is anything else"


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Returns the pixels as stored (black is 0), and the orientation, 1 to 8.

    Raises `UnsupportedType` for other kinds of TIFF, `Unreadable` if strips or tiles are missing, and `TooLarge` if
    tiles are much larger than the picture.
    """
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        page = file.pages.first
        check_page(page, len(data), name, check_size)
        if len(file.pages) > 1:
            raise UnsupportedType(f"{name}: a TIFF of {len(file.pages)} pages; save each as a file of its own")
        return read_page(page, name), int(page.tags.valueof(ORIENTATION, 1))


def note_samples(data: bytes) -> tuple[str, ...]:
    """Returns notes on the samples of the first page, as `note_page` does."""
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        return note_page(file.pages.first)


def note_page(page: tifffile.TiffPage) -> tuple[str, ...]:
    """Returns a note if samples are floating-point numbers, and one if the last channel isn't stated to be alpha."""
    is_rounded = page.sampleformat == tifffile.SAMPLEFORMAT.IEEEFP
    is_unstated = page.extrasamples[:1] == (tifffile.EXTRASAMPLE.UNSPECIFIED,)
    return (ROUNDED,) * is_rounded + (UNSTATED,) * is_unstated


def find_profile(data: bytes) -> bytes | None:
    """Returns the colour profile of the first page, or None if there is none."""
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        profile: bytes | None = file.pages.first.tags.valueof(PROFILE)
        return profile


def check_page(page: tifffile.TiffPage, file_bytes: int, name: str, check_size: Callable[[int, int], None]) -> None:
    """Checks that a page is of a kind that is read, isn't too large and lies in the file. Raises as `decode` does."""
    sides = (page.imagelength, page.imagewidth, page.tilelength, page.tilewidth, page.rowsperstrip)
    if not all(isinstance(side, int) for side in sides):
        raise Unreadable(f"{name}: the TIFF's size is not given as single numbers; save the picture again")
    check_size(page.imagelength, page.imagewidth)
    _check_kind(page, name)
    _check_segments(page, file_bytes, name)


def read_page(page: tifffile.TiffPage, what: str) -> Pixels:
    """Reads the pixels of a page that was checked, `(H, W)` or `(H, W, C)`; black is 0. Raises `Unreadable`, with a
    message that starts with `what`, for floating-point samples that are not from 0 to 1.
    """
    stored = page.asarray(maxworkers=1)
    pixels: Pixels = round_samples(stored, what) if stored.dtype.kind == "f" else stored
    if page.axes == "SYX":
        pixels = np.moveaxis(pixels, 0, -1)
    if page.photometric == tifffile.PHOTOMETRIC.MINISWHITE:
        pixels = _invert_grey(pixels, page.samplesperpixel)
    return pixels


def _invert_grey(pixels: Pixels, samples: int) -> Pixels:
    """Turns grey in which 0 is white into grey in which 0 is black. Alpha stays as it is."""
    return np.invert(pixels) if samples == 1 else np.stack([np.invert(pixels[..., 0]), pixels[..., 1]], axis=-1)


def _check_kind(page: tifffile.TiffPage, name: str) -> None:
    colours = COLOURS.get(page.photometric) if isinstance(page.photometric, int) else None
    if colours is None:
        what = f"colours of kind {_label(page.photometric)}"
    elif not isinstance(page.bitspersample, int) or page.bitspersample not in BITS.get(page.sampleformat, ()):
        what = f"{_label(page.bitspersample)}-bit {tifffile.SAMPLEFORMAT(page.sampleformat).name} samples"
    elif page.samplesperpixel not in (colours, colours + 1):
        what = f"{_label(page.samplesperpixel)} samples a pixel"
    elif page.samplesperpixel > colours and page.extrasamples[:1] == (tifffile.EXTRASAMPLE.ASSOCALPHA,):
        what = "premultiplied alpha"
    elif page.compression not in COMPRESSIONS:
        what = f"compression {_label(page.compression)}"
    elif page.axes not in ("YX", "YXS", "SYX"):
        what = f"axes {_label(page.axes)}"
    else:
        return
    raise UnsupportedType(
        f"{name}: a TIFF of {what}; save it as 8 or 16 bit or floating-point grey or RGB, with or without plain alpha, "
        "uncompressed or by LZW, deflate or PackBits"
    )


def _check_segments(page: tifffile.TiffPage, file_bytes: int, name: str) -> None:
    """Checks that tiles are small and that all of them lie in the file: tifffile fills missing ones with zeros."""
    whole = len(page.dataoffsets) == len(page.databytecounts) == int(np.prod(page.chunked)) and all(
        size > 0 and offset + size <= file_bytes
        for offset, size in zip(page.dataoffsets, page.databytecounts, strict=True)
    )
    if not whole:
        raise Unreadable(f"{name}: damaged or cut off (pixels of the TIFF are missing); send the whole file")
    if page.is_tiled and page.tilelength * page.tilewidth > 4 * page.imagelength * page.imagewidth + (1 << 20):
        raise TooLarge(
            f"{name}: TIFF tiles of {page.tilelength}x{page.tilewidth} pixels for a picture of "
            f"{page.imagelength}x{page.imagewidth}; save it in strips"
        )


def _label(value: object) -> str:
    """Shows the value in one short line: a corrupt tag may hold thousands of numbers, or any characters."""
    return clean_text(str(getattr(value, "name", value)))
