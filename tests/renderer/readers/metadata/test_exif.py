import io
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageOps

from ciir.errors import TooLarge
from ciir.renderer.readers import pictures

PIXELS = np.random.default_rng(0).integers(0, 256, (16, 24, 3), np.uint8)
FORMATS = {"JPEG": {}, "PNG": {}, "WEBP": {"lossless": True}}


def save(form: str, **options: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(PIXELS).save(file, form, **FORMATS[form], **options)
    return file.getvalue()


def make_exif(orientation: int) -> Image.Exif:
    exif = Image.Exif()
    exif[0x0112] = orientation
    return exif


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_is_undone_as_pillow_does(form: str, orientation: int) -> None:
    data = save(form, exif=make_exif(orientation))
    upright = ImageOps.exif_transpose(Image.open(io.BytesIO(data)))
    assert upright.size == ((16, 24) if orientation > 4 else (24, 16))
    assert np.array_equal(pictures.decode(data, name="x"), np.asarray(upright))


@pytest.mark.parametrize("bits", [8, 16])
def test_the_block_of_a_png_may_follow_its_pixels(bits: int) -> None:
    """And may start with the header that JPEG has (Pillow ignores both)."""
    body = b"eXIf" + make_exif(6).tobytes()
    kind = struct.pack(">IIBBBBB", 2, 1, bits, 0, 0, 0, 0)
    row = bytes([0] * (bits // 8) + [9] * (bits // 8))
    chunks = [b"IHDR" + kind, b"IDAT" + zlib.compress(b"\0" + row), body, b"IEND"]
    data = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) for chunk in chunks
    )
    assert pictures.decode(data, name="x")[..., 0].tolist() == [[0], [9 if bits == 8 else 0x0909]]


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("body", [b"", b"II*\0", b"MM\0*\xff\xff\xff\xff", b"II*\0\x08\0\0\0\xff\xff\x12"])
def test_a_malformed_block_is_ignored(form: str, body: bytes) -> None:
    data = save(form, exif=b"Exif\0\0" + body)
    assert pictures.decode(data, name="x").shape == (16, 24, 3)


@pytest.mark.parametrize("form", FORMATS)
def test_the_size_is_checked_as_stored(form: str) -> None:
    data = save(form, exif=make_exif(6))
    with pytest.raises(TooLarge, match="16x24 pixels"):
        pictures.decode(data, name="x", max_pixels=383)
