"""Pictures written by `encode`, read by this project's decoders and by Pillow."""

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from ciir.errors import InvalidOption
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import SUFFIXES, encode, encode_png, webp
from tests.support.inputs import make_picture

PIXELS = st.tuples(
    st.sampled_from([np.uint8, np.uint16]), st.integers(1, 9), st.integers(1, 9), st.integers(1, 4)
).flatmap(lambda a: hnp.arrays(a[0], a[1:]))
SETTINGS = settings(max_examples=60)


@SETTINGS
@given(pixels=PIXELS, suffix=st.sampled_from([".png", ".PNG", ".tif", ".tiff"]))
def test_every_bit_survives_png_and_tiff(pixels, suffix):
    read = decode(encode(pixels, suffix), name="x")
    assert read.dtype == pixels.dtype
    np.testing.assert_array_equal(read, pixels)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_png_and_tiff_state_a_resolution(suffix):
    pixels = make_picture(7, 5)
    read = Image.open(io.BytesIO(encode(pixels, suffix, ppi=280.5)))
    assert read.info["dpi"] == pytest.approx((280.5, 280.5), rel=5e-5)
    np.testing.assert_array_equal(np.asarray(read), pixels)
    if suffix == ".png":
        assert "dpi" not in Image.open(io.BytesIO(encode_png(pixels))).info


@SETTINGS
@given(pixels=PIXELS)
def test_pillow_reads_the_same_png(pixels):
    read = np.asarray(Image.open(io.BytesIO(encode_png(pixels))))
    if pixels.dtype == np.uint8 or pixels.shape[2] == 1:  # Pillow keeps 8 bits of the others
        np.testing.assert_array_equal(read.reshape(pixels.shape), pixels)


@pytest.mark.parametrize(("channels", "mode"), [(1, "RGB"), (2, "RGBA"), (3, "RGB"), (4, "RGBA")])
def test_every_bit_survives_webp(channels, mode):
    pixels = make_picture(7, 5, channels)
    with Image.open(io.BytesIO(encode(pixels, ".webp"))) as image:
        assert (image.format, image.mode) == ("WEBP", mode)
        written = np.asarray(image)
    colours = np.repeat(pixels[..., :1], 3, axis=2) if channels < 3 else pixels[..., :3]
    np.testing.assert_array_equal(written[..., :3], colours)
    if mode == "RGBA":
        np.testing.assert_array_equal(written[..., 3], pixels[..., -1])


@pytest.mark.parametrize("channels", [1, 3])
def test_jpeg_is_close(channels):
    ramp = np.linspace(0, 255, 32 * 32 * 3).reshape(32, 32, 3).astype(np.uint8)[..., :channels]
    read = decode(encode(ramp, ".jpg"), name="x")
    assert read.shape == ramp.shape
    assert np.abs(read.astype(int) - ramp).max() <= 8


@pytest.mark.parametrize("channels", [1, 3])
def test_alpha_that_is_opaque_is_left_out_of_jpeg(channels):
    pixels = make_picture(7, 5, channels)
    opaque = np.concatenate([pixels, np.full((7, 5, 1), 255, np.uint8)], axis=2)
    assert encode(opaque, ".jpg") == encode(pixels, ".jpg")
    opaque[6, 4, -1] = 254
    with pytest.raises(InvalidOption, match="without transparency"):
        encode(opaque, ".jpg")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_strided_pixels_are_written_as_they_stand_and_always_alike(suffix):
    views = make_picture(12, 18)[1::3, 2::2]
    assert encode(views, suffix) == encode(views.copy(), suffix)


@pytest.mark.parametrize(
    ("shape", "dtype", "suffix", "message"),
    [
        (
            (4, 4, 2),
            np.uint8,
            ".jpeg",
            r"JPEG holds 8-bit grey or RGB without transparency, not 2 channels.*name the file \.png or \.tif",
        ),
        ((4, 4, 4), np.uint8, ".jpeg", "not 4 channels of 8 bit"),
        ((4, 4, 3), np.uint16, ".jpg", "3 channels of 16 bit"),
        ((1, 65_501, 1), np.uint8, ".jpg", "65501x1"),
        ((4, 4, 3), np.uint16, ".webp", r"WebP holds 8 bit and 16383.*\.png"),
        ((1, webp.MAX_SIDE + 1, 1), np.uint8, ".webp", "16384x1"),
        ((4, 4, 3), np.uint8, ".bmp", r"'\.bmp' can't be written"),
    ],
)
def test_what_a_format_cannot_hold_is_refused(shape, dtype, suffix, message):
    with pytest.raises(InvalidOption, match=message):
        encode(np.zeros(shape, dtype), suffix)
