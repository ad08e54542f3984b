import gc
import io
import struct
import sys
import zlib

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from ciir.errors import InputError, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.levels import ROUNDED
from ciir.renderer.readers import jpeg, pictures
from ciir.renderer.readers import png as png_reader
from ciir.renderer.readers.tiff import UNSTATED
from ciir.renderer.writers.pictures import encode


def noise(*shape: int, dtype: type = np.uint8) -> pictures.Pixels:
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max + 1, shape, dtype=dtype)


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(width: int, height: int, depth: int, colour: int, rows: bytes, *before: bytes) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    body = [chunk(b"IHDR", header), *before, chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(body)


def saved(image: Image.Image, kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


def tiff(pixels: np.ndarray, **options: object) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, pixels, **options)
    return file.getvalue()


ADAM7 = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))
ROW_BY_ROW = ((0, 0, 1, 1),)


@pytest.mark.parametrize("passes", [ROW_BY_ROW, ADAM7])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("colour", "channels"), [(0, 1), (4, 2), (2, 3), (6, 4)])
def test_png_by_hand(colour: int, channels: int, dtype: type, passes: tuple[tuple[int, ...], ...]) -> None:
    pixels = noise(11, 10, channels, dtype=dtype)
    rows = b"".join(
        b"\0" + row.astype(row.dtype.newbyteorder(">")).tobytes()
        for y, x, dy, dx in passes
        for row in pixels[y::dy, x::dx]
    )
    data = bytearray(png(10, 11, 8 * pixels.itemsize, colour, rows))
    data[28] = passes is ADAM7
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    read = pictures.decode(bytes(data), name="x")
    assert read.dtype == dtype
    assert np.array_equal(read, pixels)


@pytest.mark.parametrize(("depth", "row", "expected"), [(1, 0b10_000000, [255, 0]), (2, 0b0110_0000, [85, 170])])
def test_few_bits_of_grey_become_8(depth: int, row: int, expected: list[int]) -> None:
    read = pictures.decode(png(2, 1, depth, 0, bytes([0, row])), name="x")
    assert (read.dtype, read.shape) == (np.uint8, (1, 2, 1))
    assert read.ravel().tolist() == expected


def test_a_palette_becomes_rgb_or_rgba() -> None:
    palette = chunk(b"PLTE", bytes([1, 2, 3, 40, 50, 60]))
    rows = b"\0\x00\x01"
    opaque = pictures.decode(png(2, 1, 8, 3, rows, palette), name="x")
    assert opaque.tolist() == [[[1, 2, 3], [40, 50, 60]]]
    clear = pictures.decode(png(2, 1, 8, 3, rows, palette, chunk(b"tRNS", bytes([7]))), name="x")
    assert clear.tolist() == [[[1, 2, 3, 7], [40, 50, 60, 255]]]


@pytest.mark.parametrize(
    ("depth", "colour", "row", "key", "expected"),
    [
        (8, 0, bytes([5, 6]), [5], [[5, 0], [6, 255]]),
        (2, 0, bytes([0b01100000]), [1], [[85, 0], [170, 255]]),
        (8, 2, bytes([1, 2, 3, 1, 2, 4]), [1, 2, 3], [[1, 2, 3, 0], [1, 2, 4, 255]]),
        (16, 2, struct.pack(">6H", 1, 2, 3, 1, 2, 259), [1, 2, 3], [[1, 2, 3, 0], [1, 2, 259, 65535]]),
    ],
)
def test_the_transparent_colour_becomes_alpha(
    depth: int, colour: int, row: bytes, key: list[int], expected: list[list[int]]
) -> None:
    transparent = chunk(b"tRNS", struct.pack(f">{len(key)}H", *key))
    assert pictures.decode(png(2, 1, depth, colour, b"\0" + row, transparent), name="x").tolist() == [expected]


def test_png_texts_and_profiles_are_never_inflated() -> None:
    swelling = chunk(b"iCCP", b"p\0\0" + zlib.compress(bytes(1 << 20))) + chunk(b"zTXt", b"k\0\0broken")
    assert pictures.decode(png(1, 1, 8, 0, b"\0\x09", swelling), name="x").item() == 9


def test_jpeg_segments_may_be_filled_and_nothing_may_lie_between_them() -> None:
    data = WHOLE["jpg"]
    assert np.array_equal(pictures.decode(data[:2] + b"\xff\xff" + data[2:], name="x"), pictures.decode(data, name="x"))
    with pytest.raises(Unreadable, match=r"damaged or cut off .while the JPEG picture was"):
        pictures.decode(data[:2] + b"\xff\xe2\0\x02junk" + data[2:], name="x")


@pytest.mark.parametrize("compression", [None, "lzw", "deflate", "packbits"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("layout", ["strips", "tiles", "planar", "big endian", "BigTIFF"])
def test_tiff_layouts(compression: str | None, dtype: type, layout: str) -> None:
    pixels = noise(37, 21, 3, dtype=dtype)
    options = {
        "strips": {"rowsperstrip": 5},
        "tiles": {"tile": (16, 16)},
        "planar": {"planarconfig": "separate"},
        "big endian": {"byteorder": ">"},
        "BigTIFF": {"bigtiff": True},
    }[layout]
    stored = np.moveaxis(pixels, -1, 0).copy() if layout == "planar" else pixels
    read = pictures.decode(tiff(stored, photometric="rgb", compression=compression, **options), name="x")
    assert read.dtype == dtype
    assert read.dtype.isnative
    assert np.array_equal(read, pixels)


def test_tiff_where_0_is_white_is_invert_grey() -> None:
    pixels = noise(5, 4)
    read = pictures.decode(tiff(pixels, photometric="miniswhite"), name="x")
    assert np.array_equal(read[..., 0], 255 - pixels)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("options", [{}, {"compression": "zlib", "predictor": True}])
def test_tiff_of_floating_point_numbers_is_rounded_to_16_bit(dtype, options) -> None:
    pixels = noise(5, 4, 3).astype(dtype) / 255
    data = tiff(pixels, photometric="rgb", **options)
    read = pictures.decode(data, name="x")
    assert (read.dtype, pictures.note_samples(data)) == (np.uint16, (ROUNDED,))
    assert np.abs(read - 65535 * pixels.astype(float)).max() <= 0.51
    assert pictures.note_samples(tiff(noise(5, 4))) == ()


@pytest.mark.parametrize(("kind", "notes"), [("unspecified", (UNSTATED,)), ("unassalpha", ())])
def test_tiff_whose_last_channel_is_not_stated_to_be_alpha_has_a_note(kind, notes) -> None:
    data = tiff(noise(5, 4, 4), photometric="rgb", extrasamples=[kind])
    assert pictures.note_samples(data) == notes


def test_tiff_of_numbers_beyond_1_is_refused_with_the_remedy() -> None:
    with pytest.raises(Unreadable, match=r"a\.tif has samples from .*; give floating-point numbers from 0 to 1"):
        pictures.decode(tiff(noise(5, 4).astype(np.float32)), name="a.tif")


def test_tiff_orientation_is_undone() -> None:
    pixels = noise(5, 4, 3)
    read = pictures.decode(tiff(pixels, photometric="rgb", extratags=[(274, "H", 1, 6, True)]), name="x")
    assert np.array_equal(read, np.rot90(pixels, -1))


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (tiff(noise(4, 4).astype(np.int16)), "16-bit INT"),
        (tiff(noise(4, 4).astype(np.uint32)), "32-bit UINT"),
        (tiff(noise(4, 4, 4), photometric="separated"), "SEPARATED"),
        (tiff(noise(3, 4, 4), photometric="minisblack"), "3 pages"),
        (tiff(noise(4, 4, 3), photometric="rgb", compression="zstd"), "ZSTD"),
        (tiff(noise(4, 4, 4), photometric="rgb", extrasamples=["assocalpha"]), "premultiplied"),
        (saved(Image.fromarray(noise(8, 8, 3)).convert("CMYK"), "JPEG"), "CMYK"),
        (saved(Image.fromarray(noise(8, 8, 3)), "GIF"), "PNG, JPEG, TIFF"),
        (b"Dear all, here are the views.", "PNG, JPEG, TIFF"),
    ],
)
def test_kinds_that_are_not_read(data: bytes, expected: str) -> None:
    with pytest.raises(UnsupportedType, match=expected) as caught:
        pictures.decode(data, name="views/a.png")
    assert str(caught.value).startswith("views/a.png: ")
    assert "\n" not in str(caught.value)


WHOLE = {
    "png": encode(noise(40, 30, 3), ".png"),
    "png of 16 bit": encode(noise(40, 30, 4, dtype=np.uint16), ".png"),
    "jpg": encode(noise(40, 30, 3), ".jpg"),
    "tif": encode(noise(40, 30, 3), ".tif"),
    "tif by lzw": tiff(noise(40, 30, 3), photometric="rgb", compression="lzw"),
    "tif uncompressed": tiff(noise(40, 30, 3), photometric="rgb"),
}


@pytest.mark.parametrize("kind", WHOLE)
@pytest.mark.parametrize("kept", [0.02, 0.3, 0.9, 0.999])
def test_truncated(kind: str, kept: float) -> None:
    data = WHOLE[kind]
    with pytest.raises(Unreadable, match=r"^x: .*; send the whole file$"):
        pictures.decode(data[: max(8, int(len(data) * kept))], name="x")


def test_an_empty_file() -> None:
    with pytest.raises(Unreadable, match=r"x: the file is empty \(0 bytes\); give it again"):
        pictures.decode(b"", name="x")


@settings(max_examples=60)
@given(
    kind=st.sampled_from(sorted(WHOLE)),
    changes=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=4),
    head=st.booleans(),
)
def test_corrupt_bytes_raise_one_line_or_nothing(kind: str, changes: list[tuple[float, int]], head: bool) -> None:
    data = bytearray(WHOLE[kind])
    for place, value in changes:
        data[int(place * (300 if head else len(data)))] = value
    try:
        pictures.decode(bytes(data), name="x")
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017 - most changes raise, some don't


def test_corrupt_pngs_cost_no_reference_to_none() -> None:
    broken = WHOLE["png"][:600] + WHOLE["png"][-12:]
    gc.collect()  # what earlier tests left behind holds references too
    before = sys.getrefcount(None)
    for _ in range(2000):
        with pytest.raises(Unreadable):
            pictures.decode(broken, name="x")
    assert sys.getrefcount(None) > before - 1000


@pytest.mark.parametrize(("width", "height"), [(1_000_000, 1), (2**31 - 1, 2**31 - 1)])
def test_a_huge_png_header_is_refused(width: int, height: int) -> None:
    with pytest.raises(TooLarge, match=f"^x: {height}x{width} pixels .* crop it or scale it down$"):
        pictures.decode(png(width, height, 16, 6, b"\0"), name="x")


def test_a_huge_jpeg_header_is_refused() -> None:
    data = bytearray(WHOLE["jpg"])
    frame = data.index(b"\xff\xc0")
    data[frame + 5 : frame + 9] = struct.pack(">HH", 65_000, 65_000)
    with pytest.raises(TooLarge, match="65000x65000"):
        pictures.decode(bytes(data), name="x")


def test_a_huge_tiff_header_is_refused() -> None:
    data = tiff(noise(7, 9)).replace(struct.pack("<HHII", 256, 4, 1, 9), struct.pack("<HHII", 256, 4, 1, 1 << 31))
    with pytest.raises(TooLarge, match="7x2147483648"):
        pictures.decode(data, name="x")


def test_a_tiff_tag_of_control_characters_is_reported_in_one_line() -> None:
    data = bytearray(encode(np.zeros((4, 4, 3), np.uint8), ".tif"))
    tag = data.index(struct.pack("<HHI", 259, 3, 1))  # compression, a number
    data[tag : tag + 12] = struct.pack("<HHI4s", 259, 2, 2, b"\1\n")  # text
    with pytest.raises(UnsupportedType, match=r"a TIFF of compression \?") as caught:
        pictures.decode(bytes(data), name="a.tif")
    assert str(caught.value).isprintable()


def test_huge_tiff_tiles_are_refused() -> None:
    data = tiff(noise(7, 9), tile=(16, 16)).replace(struct.pack("<HHI", 322, 3, 1), struct.pack("<HHI", 322, 4, 1))
    data = data.replace(struct.pack("<HHII", 322, 4, 1, 16), struct.pack("<HHII", 322, 4, 1, 1 << 24))
    with pytest.raises(TooLarge, match="tiles of 16x16777216"):
        pictures.decode(data, name="x")


def test_the_limit_is_the_callers() -> None:
    assert pictures.decode(WHOLE["png"], name="x", max_pixels=1200).shape == (40, 30, 3)
    for data in WHOLE.values():
        with pytest.raises(TooLarge, match=r"40x30 .* limit of 1,199 "):
            pictures.decode(data, name="x", max_pixels=1199)


def test_a_png_without_pixels_is_unreadable() -> None:
    with pytest.raises(Unreadable, match="0x3 pixels"):
        pictures.decode(png(3, 0, 8, 0, b""), name="x")


@pytest.mark.parametrize(
    ("error", "refusal", "message"),
    [
        (MemoryError(), TooLarge, "x: decoding it takes more memory than there is; crop it"),
        (KeyError("a library's words"), Unreadable, r"was decoded\); send the whole file$"),
    ],
)
def test_errors_of_decoders(
    error: Exception, refusal: type[InputError], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*args: object) -> None:
        raise error

    monkeypatch.setattr(png_reader, "decode", fail)
    with pytest.raises(refusal, match=message):
        pictures.decode(WHOLE["png"], name="x")


def test_scans_without_end_are_refused() -> None:
    data = WHOLE["jpg"]
    scan = data[data.rindex(b"\xff\xda") : -2]
    more = data[:-2] + scan * jpeg.MAX_SCANS + data[-2:]
    with pytest.raises(TooLarge, match="a JPEG of 101 scans; at most 100 are read; save it without progression"):
        pictures.decode(more, name="x")
