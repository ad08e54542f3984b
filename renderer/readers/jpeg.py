"""Decodes JPEG with Pillow, because imagecodecs accepts a truncated JPEG."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

# Image.open is not used: it would try other decoders and warn about large pictures.
from PIL.JpegImagePlugin import JpegImageFile

from ciir.errors import TooLarge, UnsupportedType
from ciir.renderer.readers.metadata.exif import HEADER, read_orientation
from ciir.renderer.readers.picture_sizes import START_OF_SCAN, list_segments

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels

MAX_SCANS = 100
"""The most scans in a progressive JPEG. Encoders write about ten."""
QUANTISATION = 0xDB
APP1, APP2 = 0xE1, 0xE2  # Exif and XMP; colour profile and multi-picture index
PROFILE = b"ICC_PROFILE\0"


class Luma(NamedTuple):
    """The brightness as a JPEG stores it."""

    pixels: NDArray[np.uint8]
    """The pixels, `(H, W)`."""
    steps: NDArray[np.float32]
    """`(8, 8)`: the steps of which the cosine coefficients of 8x8 pixels are multiples, vertical frequencies down."""


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Returns the pixels as stored, and the orientation, 1 to 8.

    Raises `UnsupportedType` for colours that are neither grey nor RGB (CMYK needs its profile to become RGB), and
    `TooLarge` over `MAX_SCANS`.
    """
    data, exif = _split_metadata(data)
    # Nowhere else in the coded pixels does this byte follow 0xFF. Each scan of a progressive JPEG covers all pixels.
    scans = data.count(bytes([0xFF, START_OF_SCAN]))
    if scans > MAX_SCANS:
        raise TooLarge(f"{name}: a JPEG of {scans:,} scans; at most {MAX_SCANS} are read; save it without progression")
    with JpegImageFile(io.BytesIO(data)) as image:
        check_size(image.height, image.width)
        if image.mode not in ("L", "RGB"):
            raise UnsupportedType(f"{name}: a JPEG of {image.mode} colours; convert it to RGB or grey")
        return np.asarray(image), read_orientation(exif)


def decode_luma(data: bytes) -> Luma | None:
    """Decodes the brightness in a JPEG that `decode` reads. Returns None if it is not stored upright, is stored as RGB
    or not at full size, or if quantisation tables follow the first scan, which Pillow doesn't list.
    """
    data, exif = _split_metadata(data)
    if read_orientation(exif) != 1 or bytes([0xFF, QUANTISATION]) in data[data.find(bytes([0xFF, START_OF_SCAN])) :]:
        return None
    with JpegImageFile(io.BytesIO(data)) as image:
        _, *sampling, table = image.layer[0]
        is_rgb = image.mode == "RGB" and (image.info.get("adobe_transform") == 0 or image.layer[0][0] == ord("R"))
        if is_rgb or any(sampling[axis] < layer[1 + axis] for axis in (0, 1) for layer in image.layer):
            return None
        steps = np.maximum(np.array(image.quantization[table], np.float32), 1).reshape(8, 8)  # damaged files may hold 0
        image.draft("L", image.size)
        return Luma(np.asarray(image), steps)


def find_profile(data: bytes) -> bytes | None:
    """Returns the colour profile from segments APP2 in their order (ICC.1:2022, B.4), or None if there is none."""
    found = {
        segment[16]: segment[18:] for kind, segment in list_segments(data) if kind == APP2 and segment[4:16] == PROFILE
    }
    return b"".join(found[number] for number in sorted(found)) if found else None


def _split_metadata(data: bytes) -> tuple[bytes, bytes]:
    """Returns the JPEG without APP1 and APP2, and its Exif block from the TIFF header on ("" if there is none).

    Pillow would read those segments, too, and print warnings about malformed data in them.
    """
    kept, exif = [data[:2]], b""
    for kind, segment in list_segments(data):
        if kind == APP1 and segment[4:10] == HEADER:
            exif = exif or segment[10:]
        if kind not in (APP1, APP2):
            kept.append(segment)
    return b"".join(kept), exif
