"""Pieces of work: an input seen through a lens array, and the true views with which upscaling is compared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from ciir.bit_depth import count_unused_bits, raise_levels
from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.sampling import average_pictures
from ciir.renderer.scene import Scene
from ciir.renderer.views import parse_views
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct
from ciir.service.pipeline.source import Input

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.service.pipeline.options import Sampling
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

SCALE = 2
PIXELS = (15, 15)
"""Pixels under each lens for a mesh by default."""
LEAST = 4
"""In pixels: smaller views of a light field can't be halved for a `pinhole` array."""
SAMPLINGS: tuple[Sampling, ...] = ("pinhole", "lenslet")


@dataclass(frozen=True, eq=False)
class Work:
    """One input as one lens array sees it."""

    name: str
    kind: Literal["mesh", "light field"]
    lenses: tuple[int, int]
    sampling: Sampling
    source: Source
    options: Options
    """The options that all methods share; five views (`cross`)."""
    truth: NDArray[np.uint8]
    """`(n, 2*rows, 2*cols, 3)`: the views of the array of the same extent with half the pitch, each pixel averaged over
    its own cell."""
    object: NDArray[np.bool_] | None
    """`(n, 2*rows, 2*cols)`: pixels that are at least half covered by the mesh; None for light fields."""


def convert_to_rgb(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Converts `(..., C)`, C from 1 to 4, to `(..., 3)`; alpha is dropped."""
    return np.repeat(pixels[..., :1], 3, axis=-1) if pixels.shape[-1] < 3 else pixels[..., :3]


def reconstruct_views(source: Source, options: Options) -> tuple[NDArray[np.uint8], Report]:
    """Returns the views that `options` select, `(n, H, W, 3)` 8 bit, and the report. 16 bits count as fully used."""
    writer = MemoryWriter()
    report = reconstruct(source, options, writer)
    pixels = np.stack(list(writer.views.values()))
    pixels = raise_levels(pixels, count_unused_bits(pixels))
    eight = pixels if pixels.dtype == np.uint8 else (pixels.astype(np.uint32) + 128) // 257
    return convert_to_rgb(eight.astype(np.uint8)), report


def list_works(source: Source, name: str, *, lenses: Sequence[int], array: Options) -> Iterator[Work]:
    """Yields the pieces of work for `source`.

    For a mesh, there is one for each count of `lenses` and sampling; for an elemental image array or a set of views,
    one for each sampling, at half its own resolution.

    `array`: how an elemental image array is read (`lenses`, `pixels`, `pickup`); a mesh is seen through its `pixels`.
    Raises the input errors of `ciir.errors`.
    """
    if isinstance(Input(source).read(array), Scene):
        for count in lenses:
            yield from _list_mesh_works(source, name, count, array.pixels or PIXELS)
    else:
        yield from _list_light_field_works(source, name, array)


def _list_mesh_works(source: Source, name: str, count: int, pixels: tuple[int, int]) -> Iterator[Work]:
    """Yields work for a mesh, whose truth is rendered by rays."""
    options = Options(lenses=(count, count), pixels=pixels, views="cross", scale=SCALE)
    direct = replace(options, strategy="direct", backend="raytrace")
    truth = reconstruct_views(source, direct)[0]
    on_white = reconstruct_views(source, replace(direct, background=(255, 255, 255)))[0]
    covered = (on_white[..., 0].astype(int) - truth[..., 0]) < 128
    for sampling in SAMPLINGS:
        sampled = replace(options, sampling=sampling)
        yield Work(name, "mesh", (count, count), sampling, source, sampled, truth, covered)


def _list_light_field_works(source: Source, name: str, array: Options) -> Iterator[Work]:
    """Yields work for a light field: its views are the truth for those of a lens array with twice the pitch."""
    every, report = reconstruct_views(source, replace(array, views="all", model="none", scale=1))
    v, u = report["lens_array"]["pixels_v"], report["lens_array"]["pixels_u"]
    if min(every.shape[1:3]) < LEAST:
        raise InvalidOption(f"{name}: views of {every.shape[1]}x{every.shape[2]} pixels; give views of {LEAST} or more")
    for sampling in SAMPLINGS:
        low, high = halve(every, sampling)
        rows, cols = low.shape[1:3]
        eia = LightField(low.reshape(v, u, *low.shape[1:])).eia()
        file = Bundle.from_upload(f"{name}.png", encode_png(eia))
        options = Options(lenses=(rows, cols), views="cross", scale=SCALE, sampling=sampling)
        truth = np.stack([high[row * u + col] for row, col in parse_views("cross", v, u)])
        yield Work(name, "light field", (rows, cols), sampling, file, options, truth, None)


def halve(pictures: NDArray[np.uint8], sampling: Sampling) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Returns LR and HR of `(n, H, W, 3)` pictures, phase exact, cut to whole cells.

    `lenslet`: LR is the mean of 2x2 pixels. `pinhole`: a point must be smaller than a pixel of the truth, so HR is the
    picture at half its size, and LR the mean of the middle 2x2 of 4x4 pixels (as in `training.data.downscale`).
    """
    cell = 2 * SCALE if sampling == "pinhole" else SCALE
    rows, cols = (length // cell for length in pictures.shape[1:3])
    cells = pictures[:, : rows * cell, : cols * cell].reshape(len(pictures), rows, cell, cols, cell, 3)
    if sampling == "lenslet":
        return average_pictures(cells, axes=(2, 4)), cells.reshape(len(pictures), rows * cell, cols * cell, 3)
    fine = cells.reshape(len(pictures), rows * SCALE, 2, cols * SCALE, 2, 3)
    return average_pictures(cells[:, :, 1:3, :, 1:3], axes=(2, 4)), average_pictures(fine, axes=(2, 4))
