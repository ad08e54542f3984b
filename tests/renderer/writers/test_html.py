import io
import json
import re
from base64 import b64decode

import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.writer import Contents

COLOURS = np.array([[[200, 30, 30], [30, 200, 30], [30, 30, 200]], [[200, 200, 30], [30, 200, 200], [200, 30, 200]]])
"""Of six views, `(2, 3, 3)`."""


def make_light_field(dtype=np.uint8, **options):
    scale = np.iinfo(dtype).max // 255
    views = np.broadcast_to((COLOURS * scale).astype(dtype)[:, :, None, None], (2, 3, 40, 60, 3))
    return LightField(np.ascontiguousarray(views), **options)


def read_data(page):
    return json.loads(re.search(r"await start\(.*?, (.*)\);", page)[1])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_holds_every_view_in_its_place(tmp_path, dtype):
    make_light_field(dtype, depth_sense="cameras").save(tmp_path / "a.html")
    found = read_data((tmp_path / "a.html").read_text())
    pictures = [decode(b64decode(address.split(",")[1]), name="view") for address in found.pop("views")]
    assert found == {"rows": 2, "cols": 3, "height": 40, "width": 60, "depthSense": "cameras", "scale": 1}
    for picture, colour in zip(pictures, COLOURS.reshape(6, 3), strict=True):
        assert picture.shape == (40, 60, 3)
        assert np.abs(picture.astype(int) - colour).max() <= 2  # JPEG of quality 95 on a plain colour


def test_what_it_does_not_hold_is_noted(tmp_path):
    views = np.full((2, 2, 4, 4, 4), 30000, np.uint16)
    alpha, bits = "html: alpha is left out", "html: 16 bits are rounded to 8"
    assert LightField(views).save(tmp_path / "a.html") == (alpha, bits)
    assert LightField(views[..., :3]).save(tmp_path / "a.html") == (bits,)
    assert LightField(views[..., :2].astype(np.uint8)).save(tmp_path / "a.html") == (alpha,)
    assert LightField(views[..., :3].astype(np.uint8)).save(tmp_path / "a.html") == ()


def test_levels_of_cameras_of_fewer_bits_fill_the_range_in_all_views_alike(tmp_path):
    notes = LightField(make_light_field(np.uint16).views // 64).save(tmp_path / "a.html")
    assert notes[-1] == "html: no level is over 1023, so levels are multiplied by 64"
    found = read_data((tmp_path / "a.html").read_text())["views"]
    for address, colour in zip(found, COLOURS.reshape(6, 3), strict=True):
        assert np.abs(decode(b64decode(address.split(",")[1]), name="view").astype(int) - colour).max() <= 3


def test_nothing_is_loaded_from_elsewhere(tmp_path):
    make_light_field().save(tmp_path / "a.html")
    assert not re.search(r"https?:|src=|href=|^import", (tmp_path / "a.html").read_text(), re.MULTILINE)


def test_the_name_of_an_input_is_text():
    file = io.BytesIO()
    writer = FileWriter(file, "html")
    writer.begin(Contents(((0, 0),), (1, 1), 4, 4, 3, np.dtype(np.uint8)))
    writer.write((0, 0), np.zeros((4, 4, 3), np.uint8))
    writer.finish({"input": {"name": "</title><script>alert(1)</script>"}})
    assert b"<script>alert" not in file.getvalue()


def test_some_views_are_refused():
    writer = FileWriter(io.BytesIO(), "html")
    with pytest.raises(InvalidOption, match=r"whole light fields and 1 view is wanted; give views all"):
        writer.begin(Contents(((0, 0),), (2, 2), 4, 4, 3, np.dtype(np.uint8)))
