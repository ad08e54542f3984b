"""HDF5 behind a user block without MATLAB's header, such as other programs write for files named .mat."""

import io

import h5py
import numpy as np
import pytest

from ciir.errors import UnsupportedType
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle

VIEWS = np.random.default_rng(0).integers(0, 256, (3, 4, 9, 8, 3), np.uint8)


def make_hdf5(size: int, block: bytes, **options: object) -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=size) as file:
        file.create_dataset("LF", data=VIEWS, **options)
    data = buffer.getvalue()
    return block + data[len(block) :]


@pytest.mark.parametrize("name", ["a.mat", "a.h5", "a"])
@pytest.mark.parametrize("size", [512, 4096])
@pytest.mark.parametrize("block", [b"", b"HDF5-based Julia Data Format\0"])
@pytest.mark.parametrize("options", [{}, {"compression": "gzip", "chunks": (1, 1, 9, 8, 3)}])
def test_it_is_read_as_hdf5(name: str, size: int, block: bytes, options: dict[str, object]) -> None:
    data = make_hdf5(size, block, **options)
    assert np.array_equal(inputs.read(Bundle(name, name, {name: data})).views, VIEWS)


def test_another_suffix_is_refused() -> None:
    with pytest.raises(UnsupportedType, match=r"the suffix is that of PNG but the content is (MAT|HDF5); rename it"):
        inputs.read(Bundle("a.png", "a.png", {"a.png": make_hdf5(512, b"")}))
