import io
import json
import struct
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.writer import Contents
from tests.support.light_fields import make_views

JPEG = 6
"""Levels by which JPEG of quality 90 changes pixels of a smooth picture at most."""


def make_field(rows=3, cols=4, height=33, width=50, *, channels=3, dtype=np.uint8):
    """Views of a colour gradient each, brighter from view to view."""
    y, x = np.mgrid[:height, :width]
    ramp = np.stack([60 + 0.8 * y, 60 + 0.8 * x, np.full(y.shape, 80), np.full(y.shape, 255)], -1)
    steps = 100 * np.arange(rows * cols).reshape(rows, cols, 1, 1, 1) / (rows * cols)
    views = (ramp + steps * [1, 1, 1, 0])[..., :channels]
    return LightField((views * (np.iinfo(dtype).max / 255)).astype(dtype), depth_sense="cameras")


def save(field, path):
    field.save(path, format="tiles")
    return zipfile.ZipFile(path)


def read_views(archive, tile, cols):
    """By (v, u), as the description says."""
    with Image.open(archive.open(tile["file"])) as picture:
        mosaic = np.asarray(picture)
    assert mosaic.shape[:2] == (tile["rows"] * tile["cell_height"], cols * tile["cell_width"])
    for v, u in np.ndindex(tile["rows"], cols):
        top, left = v * tile["cell_height"], u * tile["cell_width"]
        yield (tile["row"] + v, u), mosaic[top : top + tile["height"], left : left + tile["width"]]


def test_every_view_is_in_its_place(tmp_path):
    field = make_field()
    with save(field, tmp_path / "a.zip") as archive:
        described = json.loads(archive.read("light_field.json"))
        coarse, *fine = described.pop("tiles")
        assert described == {"rows": 3, "cols": 4, "height": 33, "width": 50, "depth_sense": "cameras", "scale": 1}
        found = {view: pixels for tile in fine for view, pixels in read_views(archive, tile, 4)}
        small = dict(read_views(archive, coarse, 4))
    assert sorted(found) == sorted(small) == list(np.ndindex(3, 4))
    for view, pixels in found.items():
        assert pixels.shape == (33, 50, 3)
        assert np.abs(pixels.astype(int) - field.views[view]).max() <= JPEG
        mean = field.views[view].mean(axis=(0, 1))  # a quarter of each side: the means of the same areas
        assert small[view].shape == (9, 13, 3)
        assert np.abs(small[view].mean(axis=(0, 1)) - mean).max() <= 1.5


def test_the_coarse_tile_is_the_mean_of_areas(tmp_path):
    field = LightField(make_views((2, 2), side=64, disparities=(1, 2), channels=3))
    with save(field, tmp_path / "a.zip") as archive:
        (coarse, *_) = json.loads(archive.read("light_field.json"))["tiles"]
        for view, pixels in read_views(archive, coarse, 2):
            expected = field.views[view].reshape(16, 4, 16, 4, 3).mean(axis=(1, 3))
            # JPEG makes 3 of this texture, and a pixel of shift before it is shrunk 9 to 10.
            assert np.abs(pixels - expected).mean() < 5


def test_the_tiles_come_coarse_first_then_from_the_middle(tmp_path):
    with save(make_field(rows=5), tmp_path / "a.zip") as archive:
        names = archive.namelist()
        described = json.loads(archive.read("light_field.json"))["tiles"]
    assert names == ["light_field.json", "coarse.jpg", *(f"row_0{row}.jpg" for row in (2, 1, 3, 0, 4))]
    assert [tile["file"] for tile in described] == names[1:]


def test_a_reader_needs_no_directory(tmp_path):
    """The members are stored, and each local header (APPNOTE.TXT 4.3.7) has the size of what follows it."""
    with save(make_field(), tmp_path / "a.zip") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    data, at, found = (tmp_path / "a.zip").read_bytes(), 0, {}
    while data[at : at + 4] == b"PK\3\4":
        flags, method, *_, size, _, name, extra = struct.unpack("<4xxxHHHHIIIHH", data[at : at + 30])
        assert (method, flags & 8) == (0, 0)
        start = at + 30 + name + extra
        found[data[at + 30 : at + 30 + name].decode()] = data[start : start + size]
        at = start + size
    assert found == members


@pytest.mark.parametrize(
    ("channels", "dtype", "notes"),
    [
        (1, np.uint8, []),
        (2, np.uint16, ["tiles: alpha is left out", "tiles: 16 bits are rounded to 8"]),
        (4, np.uint8, ["tiles: alpha is left out"]),
    ],
)
def test_what_is_left_out_is_noted(tmp_path, channels, dtype, notes):
    field = make_field(channels=channels, dtype=dtype)
    assert field.save(tmp_path / "a.zip", format="tiles") == ("tiles are JPEG of quality 90", *notes)
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        tile = json.loads(archive.read("light_field.json"))["tiles"][1]
        for view, pixels in read_views(archive, tile, 4):
            expected = field.views[view][..., : min(channels, 3)].squeeze() / (np.iinfo(dtype).max // 255)
            if channels == 2:
                expected = expected[..., 0]
            assert np.abs(pixels - expected).max() <= JPEG


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_levels_of_cameras_of_fewer_bits_fill_the_range_in_all_views_alike(tmp_path, bits):
    field = make_field(channels=1, dtype=np.uint16)
    notes = LightField(field.views >> (16 - bits), depth_sense="cameras").save(tmp_path / "a.zip", "tiles")
    assert notes[-1] == f"tiles: no level is over {2**bits - 1}, so levels are multiplied by {2 ** (16 - bits)}"
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        for tile in json.loads(archive.read("light_field.json"))["tiles"][1:]:
            for view, pixels in read_views(archive, tile, 4):
                assert np.abs(pixels - field.views[view][..., 0] / 257).max() <= JPEG + 1


@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 20), st.integers(1, 20))
@settings(max_examples=30)
def test_any_size_is_read_back(rows, cols, height, width):
    field = make_field(rows, cols, height, width)
    file = io.BytesIO()
    contents = Contents(tuple(np.ndindex(rows, cols)), (rows, cols), height, width, 3, np.dtype(np.uint8), "cameras")
    with FileWriter(file, "tiles") as writer:
        writer.begin(contents)
        for view in contents.views:
            writer.write(view, field.views[view])
        writer.finish({"notes": []})
    with zipfile.ZipFile(file) as archive:
        _, *fine = json.loads(archive.read("light_field.json"))["tiles"]
        for tile in fine:
            for view, pixels in read_views(archive, tile, cols):
                assert np.abs(pixels.astype(int) - field.views[view]).max() <= JPEG


def test_a_row_that_jpeg_cannot_hold_is_refused():
    contents = Contents(tuple(np.ndindex(2, 66)), (2, 66), 8, 1000, 3, np.dtype(np.uint8))
    with pytest.raises(InvalidOption, match=r"66 views of 1000 pixels side by side; tiles hold 65500"):
        FileWriter(io.BytesIO(), "tiles").begin(contents)
