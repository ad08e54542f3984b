import io
import struct

import numpy as np
import pytest
from PIL import Image

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers import pictures
from ciir.renderer.readers.registry import SUFFIXES, identify

PIXELS = np.random.default_rng(0).integers(0, 256, (7, 5, 4), np.uint8)


def save(image: Image.Image) -> bytes:
    file = io.BytesIO()
    image.save(file, "BMP")
    return file.getvalue()


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_pixels_are_kept(channels: int) -> None:
    pixels = PIXELS[..., :channels]
    data = save(Image.fromarray(pixels.squeeze()))
    if channels == 4:  # Pillow writes no mask of alpha; the header's version 4 has one
        masks = struct.pack("<4I4s36x12x", 0xFF0000, 0xFF00, 0xFF, 0xFF000000, b"sRGB")
        header = struct.pack("<IiiHHIIiiII", 108, 5, 7, 1, 32, 3, 0, 0, 0, 0, 0) + masks
        data = (
            b"BM" + struct.pack("<IHHI", 0, 0, 0, 14 + len(header)) + header + pixels[::-1, :, [2, 1, 0, 3]].tobytes()
        )
    assert np.array_equal(pictures.decode(data, name="a"), pixels)


def test_palettes() -> None:
    coloured = Image.fromarray(PIXELS[..., :3]).quantize(9)
    assert np.array_equal(pictures.decode(save(coloured), name="a"), np.asarray(coloured.convert("RGB")))
    black_and_white = Image.fromarray(PIXELS[..., 0]).convert("1")
    assert np.array_equal(pictures.decode(save(black_and_white), name="a")[..., 0], np.asarray(black_and_white) * 255)


def test_rows_from_the_top() -> None:
    header = struct.pack("<IiiHHIIiiII", 40, 1, -2, 1, 24, 0, 0, 0, 0, 0, 0)
    data = b"BM" + struct.pack("<IHHI", 0, 0, 0, 54) + header + bytes([3, 2, 1, 0, 6, 5, 4, 0])
    assert pictures.decode(data, name="a").tolist() == [[[1, 2, 3]], [[4, 5, 6]]]


def test_the_size_is_checked_before_pixels_are_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    data = save(Image.fromarray(PIXELS[..., :3]))
    monkeypatch.setattr(Image.Image, "convert", pytest.fail)
    with pytest.raises(TooLarge, match=r"9000x8000 pixels \(rows x columns\) are over the limit of 1,000"):
        pictures.decode(data[:18] + struct.pack("<ii", 8000, 9000) + data[26:], name="a", max_pixels=1000)


def test_truncated_at_any_place() -> None:
    data = save(Image.fromarray(PIXELS[..., :3]))
    for end in range(2, len(data) - 2, 3):
        with pytest.raises(Unreadable, match="damaged or cut off"):
            pictures.decode(data[:end], name="a")


def test_run_lengths_are_refused() -> None:
    header = struct.pack("<2sIHHI", b"BM", 1098, 0, 0, 1078) + struct.pack(
        "<IiiHHIIiiII", 40, 5, 7, 1, 8, 1, 9, 0, 0, 256, 0
    )
    with pytest.raises(UnsupportedType, match="a: a run-length encoded BMP; save it uncompressed, or as PNG"):
        pictures.decode(header + bytes(1024) + b"\5\1\0\0" * 7, name="a")


@pytest.mark.parametrize("words", [b"BMW, front left", b"P6 bracket", b"P5\n"])
def test_the_words_at_the_start_of_an_stl_are_no_picture(words: bytes) -> None:
    data = words.ljust(80, b"\0") + struct.pack("<I", 1) + bytes(50)
    assert identify("a.stl", data) is SUFFIXES[".stl"]
    assert identify("a", data).name in ("BMP", "PPM")
