"""Converts elemental image arrays to views and back, in memory and through files, bit for bit."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, cast

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.view_set import reader as view_set
from ciir.renderer.writers.pictures import encode

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import Pickup

DEPTHS = (np.uint8, np.uint16)
GRIDS = ((1, 1, 1, 1), (1, 9, 5, 1), (3, 1, 2, 7), (5, 7, 3, 9), (13, 11, 4, 6))
"""Rows and columns of lenses, then of pixels under each: odd numbers, single ones, and no two alike."""
PICKUPS: tuple[Pickup, ...] = ("virtual", "optical")


def pixel_mapping(effort: Effort) -> Iterator[Found | Skipped]:
    """Converts elemental image arrays of each depth and number of channels to views and back: PNG, TIFF, a PNG for each
    view.
    """
    random = np.random.default_rng(0)
    for depth in DEPTHS:
        lost = dict.fromkeys(("in memory", "by PNG", "by TIFF", "by files of views"), (0, ""))
        for channels, (rows, cols, pixels_v, pixels_u), pickup in itertools.product(
            (1, 2, 3, 4), GRIDS[-2:] if effort.quick else GRIDS, PICKUPS
        ):
            shape = (rows * pixels_v, cols * pixels_u, channels)
            eia = cast("Pixels", random.integers(0, np.iinfo(depth).max + 1, shape, dtype=depth))
            field = LightField.from_eia(eia, rows=rows, cols=cols, pickup=pickup)
            back = field.eia(pickup=pickup)
            returned = (
                back,
                _encode_and_decode(back, ".png"),
                _encode_and_decode(back, ".tif"),
                _write_and_read_views(field).eia(pickup=pickup),
            )
            where = f"{channels} channels, {rows}x{cols} lenses of {pixels_v}x{pixels_u} pixels, {pickup}"
            for way, picture in zip(lost, returned, strict=True):
                lost[way] = max(lost[way], (_count_differences(picture, eia), where))
        for way, (values, where) in lost.items():
            what = f"{8 * np.dtype(depth).itemsize} bit, to views and back {way}: values that differ"
            yield Found(what, 0.0, float(values), where if values else "")


def _count_differences(one: Pixels, other: Pixels) -> int:
    """Returns the number of values that differ; all if shape or depth differ."""
    return int((one != other).sum()) if one.shape == other.shape and one.dtype == other.dtype else other.size


def _encode_and_decode(picture: Pixels, suffix: str) -> Pixels:
    return pictures.decode(encode(picture, suffix), name=f"picture{suffix}")


def _write_and_read_views(field: LightField) -> LightField:
    """Writes the light field as a PNG for each view and reads it again."""
    pixels_v, pixels_u = field.views.shape[:2]
    files = {
        f"view_{v:02d}_{u:02d}.png": encode(field.views[v, u], ".png") for v in range(pixels_v) for u in range(pixels_u)
    }
    return view_set.read(files, name="views", layout=Layout(order="given")).load()


CASES: tuple[Case, ...] = (pixel_mapping,)
