import io
import struct

import pytest
import tifffile
from PIL import Image

from ciir.renderer.readers import picture_sizes
from tests.support.inputs import CUBE, make_picture
from tests.support.meshes.ktx2 import UASTC

PIXELS = make_picture(300, 200)


def save(kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    Image.fromarray(PIXELS).save(file, kind, **options)
    return file.getvalue()


def save_tiff(byteorder: str, *, bigtiff: bool) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, PIXELS, byteorder=byteorder, bigtiff=bigtiff)
    return file.getvalue()


def read(start: bytes) -> tuple[int, int] | None:
    found = picture_sizes.find_format(start)
    assert found is not None
    return picture_sizes.read_size(found, start)


@pytest.mark.parametrize(
    "data",
    [
        save("png"),
        save("jpeg", exif=b"Exif\0\0" + bytes(500)),
        save("jpeg", progressive=True),
        save("bmp"),
        save("ppm"),
        save("webp"),
        save("webp", lossless=True),
        save("webp", exif=b"Exif\0\0"),  # the extended format
        save_tiff("<", bigtiff=False),
        save_tiff(">", bigtiff=True),
    ],
)
def test_the_size_stands_at_the_start(data: bytes) -> None:
    assert read(data) == read(data[:2000]) == (300, 200)
    assert read(data[:10]) is None


def test_rows_of_a_bmp_from_the_top_and_sides_of_16_bits() -> None:
    assert read(b"BM" + bytes(12) + struct.pack("<Iii", 40, 200, -300)) == (300, 200)
    assert read(b"BM" + bytes(12) + struct.pack("<IHH", 12, 200, 300)) == (300, 200)


def test_a_texture() -> None:
    assert read(UASTC) == (8, 12)


def test_the_largest_of_several_frames_of_a_jpeg() -> None:
    data = save("jpeg")
    frame = b"\xff\xc0\0\x0b\x08\0\x08\0\x08\x01\x01\x11\0"  # 8x8 pixels, one channel
    scan = data.index(b"\xff\xda")
    for place in (2, scan):
        assert read(data[:place] + frame + data[place:]) == (300, 200)


def test_what_is_no_picture_or_states_no_size() -> None:
    assert picture_sizes.find_format(CUBE) is None
    for start in (b"\xff\xd8\xff damaged", b"RIFF\0\0\0\0WAVEfmt ", b"II*\0\xff\xff\xff\xff"):
        assert read(start) is None
