"""What is written is read here by scipy and h5py, as MATLAB's and HCI's users do."""

import io

import h5py
import numpy as np
import pytest
import scipy.io

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.writer import Contents

SHAPE = (2, 3, 4, 6)


def make(sense, dtype, channels=3):
    views = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (*SHAPE, channels), dtype, endpoint=True)
    return LightField(views, depth_sense=sense)


def cameras(field, v, u):
    """View (v, u) counted as cameras are."""
    return field.view(v, u) if field.depth_sense == "cameras" else field.view(1 - v, 2 - u)


@pytest.mark.parametrize("sense", ["cameras", "lenses"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_mat(tmp_path, sense, dtype):
    field = make(sense, dtype)
    notes = field.save(tmp_path / "a.mat")
    found = scipy.io.loadmat(tmp_path / "a.mat")["LF"]
    assert found.dtype == dtype
    for v, u in np.ndindex(2, 3):
        np.testing.assert_array_equal(found[v, u], cameras(field, v, u))
    assert ["reversed" in note for note in notes] == [True] * (sense == "lenses")


@pytest.mark.parametrize("sense", ["cameras", "lenses"])
def test_mat73(tmp_path, sense):
    field = make(sense, np.uint16)
    field.save(tmp_path / "a.mat", "mat73")
    assert (tmp_path / "a.mat").read_bytes().startswith(b"MATLAB 7.3 MAT-file")
    with h5py.File(tmp_path / "a.mat") as file:
        assert file["LF"].attrs["MATLAB_class"] == b"uint16"
        found = file["LF"][()]  # [c, x, y, u, v]
    for v, u, y, x, c in np.ndindex(*SHAPE, 3):
        assert found[c, x, y, u, v] == cameras(field, v, u)[y, x, c]


@pytest.mark.parametrize("sense", ["cameras", "lenses"])
def test_hci(tmp_path, sense):
    field = make(sense, np.uint8)
    notes = field.save(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        found, sizes = file["LF"][()], {name: file.attrs[name] for name in ("vRes", "hRes", "yRes", "xRes", "channels")}
    for v, u in np.ndindex(2, 3):
        np.testing.assert_array_equal(found[v, 2 - u], cameras(field, v, u))
    assert sizes == {"vRes": 2, "hRes": 3, "yRes": 4, "xRes": 6, "channels": 3}
    assert "not known" in notes[-1]


@pytest.mark.parametrize(("name", "suffix"), [("mat", "mat"), ("mat73", "mat"), ("hci", "h5")])
@pytest.mark.parametrize("sense", ["cameras", "lenses"])
@pytest.mark.parametrize("channels", [1, 3])
def test_reading_gives_the_same_light_field(tmp_path, name, suffix, sense, channels):
    field = make(sense, np.uint16, channels)
    field.save(tmp_path / f"a.{suffix}", name)
    found = inputs.read(Bundle.from_path(tmp_path / f"a.{suffix}"))
    assert found.depth_sense == "cameras"
    np.testing.assert_array_equal(found.with_depth_sense(sense).views, field.views)


def test_what_is_over_the_sizes_of_version_5_is_refused():
    contents = Contents(tuple(np.ndindex(17, 17)), (17, 17), 2048, 2048, 3, np.dtype(np.uint8))
    with FileWriter(io.BytesIO(), "mat") as writer, pytest.raises(InvalidOption, match="give mat73"):
        writer.begin(contents)
