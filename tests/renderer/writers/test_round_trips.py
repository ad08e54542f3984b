"""Light fields that are written without loss and read again: the same views, and the same depth."""

import numpy as np
import pytest

from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers.samples import TAKEN_AS_CAMERAS
from ciir.renderer.readers.layout import Layout

GRID = 2, 3
EIA = {"pixels": GRID, "arrangement": "eia"}
MOSAIC = {"pixels": GRID, "arrangement": "mosaic"}
FORMATS = {
    # name: (file, how it is read, the depth sense that the format has, the numbers of channels that it holds)
    "npy": ("a.npy", {}, None, (1, 2, 3, 4)),
    "npz": ("a.npz", {}, None, (1, 2, 3, 4)),
    "zip": ("a.zip", {}, None, (1, 2, 3, 4)),
    "folder": ("a", {}, None, (1, 2, 3, 4)),
    "stack": ("a.tif", {}, None, (1, 2, 3, 4)),
    "mat": ("a.mat", {}, "cameras", (1, 3)),
    "mat73": ("a.mat", {}, "cameras", (1, 3)),
    "hci": ("a.h5", {}, "cameras", (1, 3)),
    "eslf": ("a_eslf.png", {}, "cameras", (1, 3)),
    "mosaic": ("a.png", {}, "cameras", (1, 2, 3, 4)),
    "mosaic of TIFF": ("a.tif", MOSAIC, "cameras", (1, 2, 3, 4)),
    "eia": ("a.png", {}, "lenses", (1, 2, 3, 4)),
    "eia of TIFF": ("a.tif", EIA, "lenses", (1, 2, 3, 4)),
}


@pytest.mark.parametrize("sense", ["lenses", "cameras"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(
    ("name", "channels"), [(name, count) for name, (*_, counts) in FORMATS.items() for count in counts]
)
def test_the_light_field_comes_back_to_the_bit(tmp_path, name, channels, dtype, sense):
    file, layout, own_sense, _ = FORMATS[name]
    most = np.iinfo(dtype).max
    views = np.random.default_rng(0).integers(1, most, (*GRID, 4, 5, channels), dtype, endpoint=True)
    field = LightField(views, depth_sense=sense)
    format_ = None if name == "folder" else name.removesuffix(" of TIFF")
    notes = field.save(tmp_path / file, format_)
    assert any("reversed order in v and in u" in note for note in notes) == (own_sense not in {None, sense})
    found = inputs.read(Bundle.from_path(tmp_path / file), Layout(order="given", **layout))
    assert found.views.dtype == dtype
    assert found.depth_sense == (own_sense or sense)
    assert TAKEN_AS_CAMERAS not in found.notes
    np.testing.assert_array_equal(found.with_depth_sense(sense).views, views)


@pytest.mark.parametrize("name", FORMATS)
def test_a_depth_sense_that_is_given_replaces_that_of_the_file(tmp_path, name):
    file, layout, *_ = FORMATS[name]
    field = LightField(np.random.default_rng(0).integers(1, 255, (*GRID, 4, 5, 3), np.uint8))
    field.save(tmp_path / file, None if name == "folder" else name.removesuffix(" of TIFF"))
    bundle = Bundle.from_path(tmp_path / file)
    given = inputs.read(bundle, Layout(order="given", **layout))
    for sense in ("lenses", "cameras"):
        found = inputs.read(bundle, Layout(order="given", depth_sense=sense, **layout))
        assert found.depth_sense == sense
        np.testing.assert_array_equal(found.views, given.views)
