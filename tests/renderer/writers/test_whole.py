import io
import json
from dataclasses import replace

import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers import formats
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.options import WriterOptions
from ciir.renderer.writers.writer import Contents
from tests.support.displays import CALIBRATION

WHOLE = [name for name in formats.WHOLE if name not in ("zip", "npz", "html")]
SIDE = 24
NEEDED = {
    "lenticular": WriterOptions(calibration=json.dumps(CALIBRATION)),
    "panel": WriterOptions(display="panel = {pixels = [60, 40], pitch = 0.1}\nlenses = {pitch = 1, gap = 3}"),
}
"""What must be given for a format."""
ALL = tuple(np.ndindex(3, 3))


def contents(views):
    return Contents(views, (3, 3), SIDE, SIDE, 3, np.dtype(np.uint8))


@pytest.mark.parametrize("name", WHOLE)
def test_a_part_of_the_views_is_refused(name):
    with (
        FileWriter(io.BytesIO(), name) as writer,
        pytest.raises(InvalidOption, match=f"{name} needs all views, and 1 of 3x3 .*; give views all"),
    ):
        writer.begin(contents(((1, 1),)))


@pytest.mark.parametrize(
    ("name", "is_mesh", "is_advised"), [("mp4", True, True), ("mp4", False, False), ("npy", True, False)]
)
def test_a_video_of_one_view_of_a_mesh_is_advised(name, is_mesh, is_advised):
    with FileWriter(io.BytesIO(), name) as writer, pytest.raises(InvalidOption) as refused:
        writer.begin(replace(contents(((1, 1),)), is_mesh=is_mesh))
    assert str(refused.value).endswith("give views all, or rotate 0:360:60 for a turntable") == is_advised


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("npy", {"frames": 3}, "frames: format npy has no use for it; leave it out, or give format mp4, webm, gif"),
        ("mp4", {"epi": "y=1"}, "epi: format mp4 has no use for it; leave it out, or give format epi"),
        ("zip", {"path": "sweep"}, "path: format zip has no use for it"),
    ],
)
def test_an_option_that_the_format_ignores_is_refused(name, options, message):
    with (
        FileWriter(io.BytesIO(), name, WriterOptions(**options)) as writer,
        pytest.raises(InvalidOption, match=message),
    ):
        writer.begin(contents(ALL))


@pytest.mark.parametrize("name", WHOLE)
def test_views_come_in_any_order(name):
    views = np.random.default_rng(0).integers(0, 255, (3, 3, SIDE, SIDE, 3), np.uint8)
    files = []
    for order in (ALL, ALL[::-1]):
        file = io.BytesIO()
        with FileWriter(file, name, NEEDED.get(name)) as writer:
            writer.begin(contents(order))
            for view in order:
                writer.write(view, views[view])
            writer.finish({"notes": []})
        files.append(file.getvalue())
    assert files[0] == files[1]
    assert files[0]


@pytest.mark.parametrize(
    ("name", "path"), [("mat", "a.mat"), ("mat73", "a.mat"), ("hci", "a.h5"), ("eslf", "a_eslf.png")]
)
@pytest.mark.parametrize(("channels", "dtype"), [(2, np.uint16), (4, np.uint8)])
def test_only_opaque_alpha_is_left_out_where_the_format_holds_none(tmp_path, name, path, channels, dtype):
    views = np.random.default_rng(0).integers(0, 255, (3, 3, 8, 8, channels), dtype)
    views[..., -1] = np.iinfo(dtype).max
    notes = LightField(views, depth_sense="cameras").save(tmp_path / path, name)
    assert notes[0] == f"{name} holds no alpha: it is left out, and was opaque everywhere"
    found = inputs.read(Bundle.from_path(tmp_path / path))
    np.testing.assert_array_equal(found.views, views[..., :-1])
    views[0, 0, 0, 0, -1] -= 1
    with pytest.raises(InvalidOption, match=f"{name} holds no alpha; give views without it"):
        LightField(views).save(tmp_path / path, name)
