import io
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from ciir.errors import InvalidOption
from ciir.renderer.focus.disparity import DisparityMap
from ciir.renderer.writers.depth import FORMATS, encode_disparity, find_format, write_disparity

VALUES = np.random.default_rng(1).normal(size=(5, 7)).astype(np.float32)
CONFIDENCE = np.linspace(0, 1, 35, dtype=np.float32).reshape(5, 7)


def make_map(values=VALUES, sense="cameras"):
    return DisparityMap((0, 0), values, CONFIDENCE, np.linspace(-1, 1, 9), sense)


def read_pfm(data):
    """By the format's description: three lines, then rows from the bottom."""
    kind, size, scale, pixels = data.split(b"\n", 3)
    width, height = (int(word) for word in size.split())
    assert (kind, float(scale)) == (b"Pf", -1)
    return np.frombuffer(pixels, "<f4").reshape(height, width)[::-1]


def read_png(data):
    """A 16-bit PNG by Pillow, with its scale and offset."""
    picture = Image.open(io.BytesIO(data))
    scale, offset = (float(picture.text[name]) for name in ("scale", "offset"))
    return offset + scale * np.asarray(picture)


READERS = {
    "pfm": read_pfm,
    "pfm by Pillow": lambda data: np.asarray(Image.open(io.BytesIO(data))),
    "tiff": lambda data: tifffile.imread(io.BytesIO(data)),
    "tiff by Pillow": lambda data: np.asarray(Image.open(io.BytesIO(data))),
    "png": read_png,
    "npy": lambda data: np.load(io.BytesIO(data), allow_pickle=False),
}


@pytest.mark.parametrize("reader", READERS)
def test_numbers_come_back(reader):
    data, confidence, _ = encode_disparity(make_map(), reader.split()[0])
    bound = np.ptp(VALUES) / 0xFFFF if reader == "png" else 0  # levels are half a step away at most, and float32
    np.testing.assert_allclose(READERS[reader](data), VALUES, rtol=0, atol=bound)
    np.testing.assert_allclose(READERS[reader](confidence), CONFIDENCE, rtol=0, atol=bound)


def test_larger_is_nearer():
    """With the depth sense of lenses what is farther moves further to the left: its disparity is larger."""
    data, _, _ = encode_disparity(make_map(sense="lenses"), "pfm")
    np.testing.assert_array_equal(read_pfm(data), -VALUES)


def test_a_tiff_is_one_uncompressed_page_of_floats():
    """ImageJ reads no predictor of floats, and other programs no tifffile's JSON."""
    data, _, reading = encode_disparity(make_map(), "tiff")
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        (page,) = file.pages
        assert (page.dtype, page.compression, page.photometric) == (np.float32, 1, 1)
        assert not {"ImageDescription", "Software"} & {tag.name for tag in page.tags}
    assert reading == {"format": "tiff", "sense": "larger is nearer"}


def test_a_flat_png():
    data, _, reading = encode_disparity(make_map(np.full((5, 7), -0.25, np.float32)), "png")
    np.testing.assert_allclose(read_png(data), -0.25)
    assert reading["offset"] == -0.25
    assert reading["scale"] > 0


def test_colours_span_all_but_single_pixels():
    values = np.tile(np.linspace(0, 1, 100, dtype=np.float32), (100, 1))
    values[50, 50] = 99
    data, _, reading = encode_disparity(make_map(values), "viridis")
    picture = np.asarray(Image.open(io.BytesIO(data)))
    assert picture.shape == (100, 100, 3)
    assert picture[0, 0, 2] > picture[0, 0, 0]  # blue
    assert picture[0, 99, 0] > picture[0, 99, 2]  # yellow
    assert (reading["darkest"], reading["brightest"]) == pytest.approx((0, 1), abs=0.02)


def test_writes_the_confidence_beside(tmp_path):
    report = write_disparity(tmp_path / "depth.PFM", make_map())
    assert report == {
        "file": "depth.PFM", "confidence": "depth_confidence.PFM", "format": "pfm", "sense": "larger is nearer"
    }  # fmt: skip
    np.testing.assert_array_equal(read_pfm((tmp_path / "depth_confidence.PFM").read_bytes()), CONFIDENCE)


@pytest.mark.parametrize(
    ("name", "wanted", "message"),
    [
        (
            "a.jpg",
            None,
            r"a\.jpg: a disparity map can't have this name; end it with \.pfm, \.tif, \.tiff, \.png, \.npy",
        ),
        ("a.pfm", "viridis", r"end it with \.png"),
        ("a.png", "exr", "format: 'exr' holds no disparity; give pfm, tiff, png, npy, "),
    ],
)
def test_names_that_no_format_has(name, wanted, message):
    with pytest.raises(InvalidOption, match=message):
        find_format(Path(name), wanted)


def test_a_name_gives_its_format():
    assert find_format(Path("a.PNG")) is FORMATS["png"]
    assert find_format(Path("a.tif")) is find_format(Path("a.TIFF")) is FORMATS["tiff"]
    assert find_format(Path("a.png"), "viridis") is FORMATS["viridis"]
