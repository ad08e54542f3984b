import io
import struct

import numpy as np
import pytest
from PIL import Image

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers import pictures

PIXELS = np.random.default_rng(0).integers(0, 256, (7, 5, 4), np.uint8)


def webp(pixels: np.ndarray, **options: object) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", **options)
    return file.getvalue()


@pytest.mark.parametrize("channels", [3, 4])
def test_lossless_pixels_are_kept(channels: int) -> None:
    data = webp(PIXELS[..., :channels], lossless=True, exact=True)
    assert np.array_equal(pictures.decode(data, name="a"), PIXELS[..., :channels])


@pytest.mark.parametrize("channels", [3, 4])
def test_lossy_pixels_as_pillow_decodes_them(channels: int) -> None:
    data = webp(np.repeat(np.repeat(PIXELS[..., :channels], 8, 0), 8, 1), quality=90)
    assert data[12:16] == (b"VP8 " if channels == 3 else b"VP8X")
    assert np.array_equal(pictures.decode(data, name="a"), np.asarray(Image.open(io.BytesIO(data))))


def claim_size(height: int, width: int) -> list[bytes]:
    """Each kind of header, of a picture without data."""
    extended = b"VP8X" + struct.pack("<IB3x", 10, 0) + b"".join((n - 1).to_bytes(3, "little") for n in (width, height))
    lossless = b"VP8L" + struct.pack("<IBI", 5, 0x2F, width - 1 | height - 1 << 14)
    lossy = b"VP8 " + struct.pack("<I3s3sHH", 10, b"\0\0\0", b"\x9d\x01\x2a", width, height)
    return [b"RIFF" + struct.pack("<I", 4 + len(chunk)) + b"WEBP" + chunk for chunk in (extended, lossless, lossy)]


@pytest.mark.parametrize("data", claim_size(9000, 8000))
def test_the_size_is_checked_before_the_canvas_is_allocated(data: bytes) -> None:
    with pytest.raises(TooLarge, match="9000x8000 pixels"):
        pictures.decode(data, name="a")


def test_what_is_no_single_picture() -> None:
    frames = [Image.fromarray(PIXELS[..., :3]), Image.fromarray(255 - PIXELS[..., :3])]
    file = io.BytesIO()
    frames[0].save(file, "WEBP", save_all=True, append_images=frames[1:])
    with pytest.raises(UnsupportedType, match="an animated WebP; give its pictures one by one"):
        pictures.decode(file.getvalue(), name="a")
    with pytest.raises(Unreadable, match="a RIFF file that holds no WebP"):
        pictures.decode(b"RIFF" + bytes(4) + b"WAVEfmt " + bytes(40), name="a")


@pytest.mark.parametrize("options", [{"lossless": True}, {"quality": 80}])
def test_truncated_at_any_place(options: dict[str, object]) -> None:
    data = webp(PIXELS, **options)
    for end in range(12, len(data) - 2):
        with pytest.raises(Unreadable, match=r"damaged or cut off|holds no WebP"):
            pictures.decode(data[:end], name="a")
