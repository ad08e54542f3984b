"""Seeds of files that hold a whole light field."""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, cast

import av
import h5py
import numpy as np
import tifffile
from av.container import Flags
from scipy.io import savemat

from ciir.renderer.readers.containers.mat import VERSION_5
from ciir.renderer.readers.lenslet.grid import LensGrid
from ciir.renderer.writers.containers.video import Mp4Writer
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import Contents
from tests.fuzz.mutate import edit_values
from tests.fuzz.seeds import noise, zipped
from tests.fuzz.seeds import pack as pack_files
from tests.support.lenslet.lytro import expose, make_metadata, pack, write_container

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

GRID = LensGrid(8.0, (4.0, 4.0), 0.0, "hexagonal")
VIEWS = noise(16, 5, 3).reshape(2, 2, 4, 5, 3)


def _save(array: NDArray[np.generic]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def npy() -> list[bytes]:
    """Integers and fractions, in both orders of axes, and with a depth sense behind them."""
    plain = _save(VIEWS)
    others = [np.asfortranarray(VIEWS), VIEWS[..., :1] * np.uint16(257), VIEWS / 255]
    return [plain, plain + _save(np.array("lenses")), *map(_save, others)]


def _npz_files() -> list[dict[str, bytes]]:
    """One array, and views with their positions."""
    positions = np.array([(1, 1), (1, 0), (0, 1), (0, 0)])
    report = np.array('{"lens_array": {"depth_sense": "lenses"}}')
    listed = {"views.npy": VIEWS.reshape(4, 4, 5, 3), "positions.npy": positions, "report.npy": report}
    return [{"a.npy": npy()[0]}, {name: _save(array) for name, array in listed.items()}]


def npz() -> list[bytes]:
    """Whole zips."""
    return [zipped(files) for files in _npz_files()]


def npz_arrays() -> list[bytes]:
    """Names, and the arrays behind them."""
    return [pack_files("\n".join(files).encode(), *files.values()) for files in _npz_files()]


def mat() -> list[bytes]:
    """Version 5, plain and packed, of integers and fractions, and of views in cells; version 7.3."""
    cells = np.empty(VIEWS.shape[:2], object)
    for view in np.ndindex(cells.shape):
        cells[view] = VIEWS[view].repeat(16, axis=0).repeat(16, axis=1)  # as large as views in cells must be
    made = []
    for is_packed, views in ((False, VIEWS), (True, VIEWS), (True, VIEWS / 255), (False, cells)):
        buffer = io.BytesIO()
        savemat(buffer, {"other": 3.0, "LF": views}, do_compression=is_packed)
        made.append(VERSION_5.ljust(116) + buffer.getvalue()[116:])  # without the date
    return [*made, hdf5()[0]]


def hdf5() -> list[bytes]:
    """As MATLAB, the HCI data set, h5py and BasicLFSR write it, and views in MATLAB's cells."""

    def fill_hci(file: h5py.File) -> None:
        file["LF"] = VIEWS
        file.attrs["dH"] = 0.1

    def fill_cells(file: h5py.File) -> None:
        cells = file.create_dataset("LF", VIEWS.shape[1::-1], h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        for v, u in np.ndindex(VIEWS.shape[:2]):
            stored = file.create_dataset(f"#refs#/{v}{u}", data=VIEWS[v, u].repeat(16, axis=0).repeat(16, axis=1).T)
            stored.attrs["MATLAB_class"] = np.bytes_("uint8")
            cells[u, v] = stored.ref

    return [
        _fill(lambda file: file.create_dataset("LF", data=VIEWS.T, compression="gzip", shuffle=True)),
        _fill(fill_hci),
        _fill(lambda file: file.create_dataset("a", data=VIEWS / 255, fletcher32=True)),
        _fill(lambda file: file.create_dataset("Hr_SAI_y", data=np.linspace(0, 1, 150).reshape(15, 10))),
        _fill(fill_cells),
    ]


def tiff_stacks() -> list[bytes]:
    """Our own, and pages with what else gives the grid: ImageJ's description, and their number."""
    file = io.BytesIO()
    with FileWriter(file, "stack") as writer:
        writer.begin(Contents(tuple(np.ndindex(2, 2)), (2, 2), 4, 5, 3, np.dtype(np.uint8)))
        for view in np.ndindex(2, 2):
            writer.write(view, VIEWS[view])
        writer.finish({"notes": []})
    described = "ImageJ=1.53\nimages=4\nslices=2\nframes=2\n"
    return [file.getvalue(), _stack(described, None), _stack(described, "lzw"), _stack("", "packbits")]


def _stack(description: str, compression: str | None) -> bytes:
    buffer = io.BytesIO()
    with tifffile.TiffWriter(buffer) as writer:
        for view in np.ndindex(2, 2):
            writer.write(
                VIEWS[view], photometric="rgb", description=description, metadata=None, compression=compression
            )
    return buffer.getvalue()


def eslf() -> list[bytes]:
    """With and without a weight; with empty views; with lenses that are cut off."""
    empty = noise(28, 42, 3)
    empty[::14] = empty[:, 13::14] = 0
    return [encode_png(pixels) for pixels in (noise(28, 42, 3), noise(28, 42, 4), empty, noise(27, 40, 3))]


def mp4() -> list[bytes]:
    """Of our writer's two codecs, with its settings, which give the same bytes each time."""
    return [
        _film("mp4", codec, "yuv420p", settings) for codec, settings in Mp4Writer.codecs if codec in av.codecs_available
    ]


def matroska() -> list[bytes]:
    """With and without loss."""
    return [_film("webm", "libvpx-vp9", "yuv420p"), _film("matroska", "ffv1", "bgr0")]


def gif() -> list[bytes]:
    """An animation."""
    return [_film("gif", "gif", "rgb8")]


def _film(container: str, codec: str, pixel_format: str, settings: Mapping[str, str] | None = None) -> bytes:
    """Three frames of 16x16 pixels, the same bytes each time."""
    buffer = io.BytesIO()
    with av.open(buffer, "w", format=container) as file:
        file.flags |= cast("int", Flags.bitexact.value)
        stream = cast("av.VideoStream", file.add_stream(codec, rate=25))
        stream.height, stream.width, stream.pix_fmt = 16, 16, pixel_format
        stream.options = {**(settings or {}), "threads": "1"}
        for number in range(3):
            frame = av.VideoFrame.from_ndarray(np.roll(noise(16, 16, 3), number, axis=1), format="rgb24")
            frame.pts = number
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    return buffer.getvalue()


def _fill(fill: Callable[[h5py.File], object]) -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        fill(file)
    return buffer.getvalue()


def lytro(edits: bytes = b"") -> list[bytes]:
    """As an F01 and an Illum write it, small, with `edits` of the values of its metadata (`mutate.edit_values`)."""
    made = []
    for model, bits in (("F01", 12), ("ILLUM", 10)):
        metadata = make_metadata(GRID, (32, 40), model)
        packed = pack(expose(noise(32, 40, 3), metadata), bits)
        metadata = json.loads(json.dumps(metadata))  # its lists are constants
        edit_values(metadata, edits)
        made.append(write_container(packed, metadata, model))
    return made


def lenslets() -> list[bytes]:
    """White lenses 7.5 pixels apart with dark borders, for each given part of the grid (`readers.lenslet`)."""
    y, x = np.mgrid[0:80, 0:80]
    picture = 200 * ((np.cos(2 * np.pi * (y - 4) / 7.5) + np.cos(2 * np.pi * (x - 4) / 7.5) + 3) / 5) ** 2
    given = [(0, 0, 0, 0, 0), (6, 0, 0, 0, 0), (6, 8, 8, 128, 1)]
    return [bytes([79, 79, *known]) + picture.astype(np.uint8).tobytes() for known in given]
