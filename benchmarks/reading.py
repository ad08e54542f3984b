"""Measures what reading a light field costs for each container, relative to decoding it with the library alone.

    python -m ciir.benchmarks.reading [--grid 15] [--side 400] [--rounds 5]

Each file is written by our own writer and read from memory. The library decodes it to arrays in their stored layout.
The reader makes a light field of it, with its checks and the order of views. Both run in turn, and the least times
count.
"""

from __future__ import annotations

import argparse
import io
import time
from typing import TYPE_CHECKING

import av
import h5py
import numpy as np
import scipy.io
import scipy.ndimage
import tifffile

from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs, pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import Layout
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.options import WriterOptions
from ciir.renderer.writers.writer import Contents

if TYPE_CHECKING:
    from collections.abc import Callable


def make_light_field(grid: int, side: int) -> LightField:
    """Makes smooth noise that moves by a pixel from view to view. It compresses about as well as pictures do."""
    margin = side + 2 * grid
    rng = np.random.default_rng(0)
    plane = scipy.ndimage.gaussian_filter(rng.normal(size=(margin, margin, 3)), (2, 2, 0))
    plane = np.clip(128 + 200 * plane + rng.normal(0, 1, plane.shape), 0, 255).astype(np.uint8)
    views = np.empty((grid, grid, side, side, 3), np.uint8)
    for v, u in np.ndindex(grid, grid):
        views[v, u] = plane[v : v + side, u : u + side]
    return LightField(views, is_ordered=True, depth_sense="cameras")


def write(light_field: LightField, name: str) -> bytes:
    """Writes the file in the format `name`; a video shows every view once."""
    count_v, count_u, height, width, channels = light_field.views.shape
    positions = tuple(np.ndindex(count_v, count_u))
    file = io.BytesIO()
    options = WriterOptions(frames=len(positions)) if name in {"mp4", "webm"} else WriterOptions()
    with FileWriter(file, name, options) as writer:
        contents = Contents(positions, (count_v, count_u), height, width, channels, light_field.views.dtype, "cameras")
        writer.begin(contents)
        for view in positions:
            writer.write(view, light_field.views[view])
        writer.finish({"notes": [], "lens_array": {"depth_sense": "cameras"}})
    return file.getvalue()


def pack_hdf5(light_field: LightField) -> bytes:
    """Packs data sets as MATLAB and h5py do: in chunks, with deflate."""
    file = io.BytesIO()
    with h5py.File(file, "w") as target:
        target.create_dataset("LF", data=light_field.views, chunks=(1, 1, *light_field.views.shape[2:]), compression=3)
    return file.getvalue()


def pack_mat(light_field: LightField) -> bytes:
    """Packs a variable as MATLAB does."""
    file = io.BytesIO()
    scipy.io.savemat(file, {"LF": light_field.views}, do_compression=True)
    return file.getvalue()


def decode_hdf5(data: bytes) -> object:
    """Decodes with h5py."""
    with h5py.File(io.BytesIO(data), "r") as file:
        return file["LF"][()]


def decode_npz(data: bytes) -> object:
    """Decodes with NumPy."""
    with np.load(io.BytesIO(data)) as arrays:
        return arrays["views"]


def decode_video(data: bytes) -> object:
    """Decodes with PyAV, to RGB."""
    with av.open(io.BytesIO(data), "r") as file:
        return np.stack([frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)])


CASES: dict[str, tuple[str, Callable[[LightField], bytes], Callable[[bytes], object]]] = {
    "npy": ("a.npy", lambda field: write(field, "npy"), lambda data: np.load(io.BytesIO(data))),
    "npz": ("a.npz", lambda field: write(field, "npz"), decode_npz),
    "mat": ("a.mat", lambda field: write(field, "mat"), lambda data: scipy.io.loadmat(io.BytesIO(data))["LF"]),
    "mat, packed": ("a.mat", pack_mat, lambda data: scipy.io.loadmat(io.BytesIO(data))["LF"]),
    "mat73": ("a.mat", lambda field: write(field, "mat73"), decode_hdf5),
    "hci": ("a.h5", lambda field: write(field, "hci"), decode_hdf5),
    "h5, packed": ("a.h5", pack_hdf5, decode_hdf5),
    "stack": ("a.tif", lambda field: write(field, "stack"), lambda data: tifffile.imread(io.BytesIO(data))),
    "eslf": (
        "a_eslf.png",
        lambda field: write(LightField(field.views[:14, :14], depth_sense="cameras"), "eslf"),
        lambda data: pictures.decode(data, name="a"),
    ),
    "mp4": ("a.mp4", lambda field: write(field, "mp4"), decode_video),
    "webm": ("a.webm", lambda field: write(field, "webm"), decode_video),
}
"""Name -> the file's name, the function that makes it, and the one that decodes it with the library alone."""


def read(data: bytes, file: str) -> object:
    """Reads with our own reader."""
    return inputs.read(Bundle.from_upload(file, data), Layout())


def measure(run: Callable[..., object], *arguments: object) -> float:
    """Returns the seconds that `run` takes."""
    start = time.perf_counter()
    run(*arguments)
    return time.perf_counter() - start


def main(argv: list[str] | None = None) -> None:
    """Prints a row of a table for each container."""
    parser = argparse.ArgumentParser(prog="ciir.benchmarks.reading", description=main.__doc__)
    parser.add_argument("--grid", type=int, default=15, help="rows and columns of views (default 15)")
    parser.add_argument("--side", type=int, default=400, help="pixels along a side of a view (default 400)")
    parser.add_argument("--rounds", type=int, default=5, help="how often each is read (default 5)")
    given = parser.parse_args(argv)
    light_field = make_light_field(given.grid, given.side)
    print("| container | file, MB | library, ms | reader, ms | ratio |\n|---|---|---|---|---|")
    for name, (file, make, decode) in CASES.items():
        data = make(light_field)
        least = [float("inf"), float("inf")]
        for _ in range(given.rounds):
            least[0] = min(least[0], measure(decode, data))
            least[1] = min(least[1], measure(read, data, file))
        library, reader = (1000 * seconds for seconds in least)
        print(f"| {name} | {len(data) / 1e6:.0f} | {library:.0f} | {reader:.0f} | {reader / library:.2f} |", flush=True)


if __name__ == "__main__":
    main()
