import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from ciir.errors import InputError, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs, pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import Layout
from tests.support.inputs import make_netpbm


def noise(channels: int, white: int) -> np.ndarray:
    return np.random.default_rng(white).integers(0, white + 1, (7, 5, channels))


@pytest.mark.parametrize("white", [255, 511, 1023, 4095, 16383, 65535])
@pytest.mark.parametrize("channels", [1, 3])
def test_levels_are_kept_as_stored(channels: int, white: int) -> None:
    stored = noise(channels, white)
    read = pictures.decode(make_netpbm(stored, white), name="a")
    assert read.dtype == (np.uint8 if white == 255 else np.uint16)
    assert read.dtype.isnative
    assert np.array_equal(read, stored)


@pytest.mark.parametrize("channels", [1, 3])
def test_8_bit_as_pillow_writes_and_reads_it(channels: int) -> None:
    stored, file = noise(channels, 255).astype(np.uint8), io.BytesIO()
    Image.fromarray(stored.squeeze()).save(file, "PPM")
    assert np.array_equal(pictures.decode(file.getvalue(), name="a"), stored)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(make_netpbm(stored, 255)))), stored.squeeze())


@pytest.mark.parametrize(
    ("white", "stored", "expected"),
    [
        (1, [0, 1], [0, 255]),
        (15, [0, 1, 15], [0, 17, 255]),
        (100, [0, 1, 50, 100], [0, 3, 128, 255]),
        (1000, [0, 1, 499, 1000], [0, 1, 510, 1023]),
        (65534, [0, 1, 65534], [0, 1, 65535]),
    ],
)
def test_white_becomes_the_next_level_of_ones(white: int, stored: list[int], expected: list[int]) -> None:
    read = pictures.decode(make_netpbm(np.array(stored).reshape(1, -1, 1), white), name="a")
    assert read.dtype == (np.uint8 if white < 255 else np.uint16)
    assert read.ravel().tolist() == expected


@pytest.mark.parametrize("white", [1, 2, 100, 254, 256, 1000, 40_000])
def test_different_levels_stay_different(white: int) -> None:
    read = pictures.decode(make_netpbm(np.arange(white + 1).reshape(1, -1, 1), white), name="a").astype(int)
    assert (np.diff(read.ravel()) >= 1).all()


@pytest.mark.parametrize(
    "header",
    [
        b"P6\n2 1\n255\n",
        b"P6 2 1 255 ",
        b"P6\r\n2\t1\r255\n",
        b"P6\n# by a camera\n2 1\n# 9 9\n255\n",
        b"P6#\n2 # wide\n1\n0255\n",
    ],
)
def test_headers(header: bytes) -> None:
    assert pictures.decode(header + bytes(range(6)), name="a").tolist() == [[[0, 1, 2], [3, 4, 5]]]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"P6\n2 1\n", "a: the PPM or PGM header has no width, height and level of white; save it again"),
        (b"P6\n2 x 255\n......", "a: the PPM or PGM header has no width"),
        (b"P6\n-2 1 255\n......", "a: the PPM or PGM header has no width"),
        (b"P6\n2 1 255", "a: the PPM or PGM header has no width"),
        (b"P6\n2 1 0\n......", r"a: the level of white \(maxval\) is 0, not 1 to 65535; save it again"),
        (b"P6\n2 1 65536\n......", r"a: the level of white \(maxval\) is 65536, not 1 to 65535"),
        (b"P6\n0 1 255\n", r"a: 1x0 pixels"),
        (b"P6\n2 1 255\n.....", r"a: 5 bytes of pixels instead of 6 \(1x2 pixels of 3 x 8 bit\): damaged or cut off"),
        (b"P5\n2 1 999\n...", r"a: 3 bytes of pixels instead of 4 \(1x2 pixels of 1 x 16 bit\): damaged or cut off"),
        (
            2 * b"P5\n2 1 255\n..",
            r"a: 15 bytes of pixels instead of 2 \(.*\); save it again, as the only picture of its",
        ),
        (b"P5\n2 1 9\n\x01\x0a", r"a: has level 10, but white \(maxval\) is 9; save it again$"),
        (
            b"P5\n2 1 1023\n\xff\3\0\0",
            "a: has level 65283, but .* is 1023; save it again with the high byte of each sam",
        ),
    ],
)
def test_corrupt_files(data: bytes, message: str) -> None:
    with pytest.raises(Unreadable, match=f"^{message}"):
        pictures.decode(data, name="a")


def test_white_space_at_the_end_is_ignored() -> None:
    assert pictures.decode(b"P5\n2 1\n255\n..\r\n", name="a").tolist() == [[[46], [46]]]


@pytest.mark.parametrize("size", [b"9000 8000", b"1 131073", b"9999999999 9999999999"])
def test_the_size_is_checked_before_anything_is_allocated(size: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(np, "frombuffer", pytest.fail)
    with pytest.raises(TooLarge, match="over the limit of 1,000,000"):
        pictures.decode(b"P6\n" + size + b"\n1023\n", name="a", max_pixels=1_000_000)


@pytest.mark.parametrize("data", [b"P3\n1 1\n255\n1 2 3\n", b"P2\n1 1\n255\n1\n"])
def test_numbers_as_text_are_refused_with_the_remedy(data: bytes) -> None:
    for suffix in ("ppm", "pgm", "pnm"):
        with pytest.raises(UnsupportedType, match=r"the content is text, not PPM; save it as binary PPM or PGM"):
            inputs.read(Bundle.from_upload(f"a.{suffix}", data))


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=40))
def test_any_bytes_after_the_signature(data: bytes) -> None:
    try:
        pixels = pictures.decode(b"P6 " + data, name="a", max_pixels=10_000)
    except InputError:
        return
    assert pixels.ndim == 3


def read(files: dict[str, bytes], **layout: object) -> LightField:
    found = inputs.read(Bundle("set", None, files), Layout(**layout))
    assert isinstance(found, LightField)
    return found


def test_the_views_of_jpeg_pleno() -> None:
    views = {(v, u): noise(3, 1023) for v in range(3) for u in range(4)}
    for (v, u), view in views.items():
        view[0, 0, 0] = 10 * v + u
    field = read({f"{v:03d}_{u:03d}.ppm": make_netpbm(view, 1023) for (v, u), view in views.items()})
    assert (field.views.shape, field.views.dtype) == ((3, 4, 7, 5, 3), np.uint16)
    for (v, u), view in views.items():
        assert np.array_equal(field.views[v, u], view)


@pytest.mark.parametrize("suffix", ["ppm", "pgm", "pnm"])
def test_an_elemental_image_array(suffix: str) -> None:
    stored = noise(1, 4095)[:6, :4]
    field = read({f"eia.{suffix}": make_netpbm(stored, 4095)}, lenses=(3, 2))
    assert (field.views.shape, field.views.dtype) == ((2, 2, 3, 2, 1), np.uint16)
    assert np.array_equal(field.views[0, 1], stored[0::2, 1::2])
