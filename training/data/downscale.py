"""Low-resolution versions of pictures, and crops of them, with exact phase.

LR sample i lies between HR samples 2i and 2i+1 (area resampling, `align_corners=False`), as with a lens array whose
pitch is twice as wide over the same extent. An error of half a pixel here costs 2 to 4 dB.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from PIL import Image

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.training.data.pictures import Picture

KINDS = ("bicubic", "box", "point")
"""Degradations of a photograph: MATLAB's `imresize`, the mean of each cell, the middle of each cell."""
POINT = (
    "the truth is the mean of each 2x2 pixels, at half the size, and an LR pixel the mean of the middle 2x2 of the "
    "pixels that it covers"
)
"""How `point` makes both pictures, for protocols."""
MARGINS = {"bicubic": 2, "box": 0, "point": 0}
"""Number of LR samples on each side of a crop that its LR depends on. The bicubic kernel ends 2 LR samples away."""


class Pair(NamedTuple):
    """A low-resolution picture `(h, w, C)` and its truth `(scale*h, scale*w, C)`, 8 bit; or `(V, U, ...)` of them."""

    low: Picture
    high: Picture


def cell_size(kind: str, scale: int) -> int:
    """Returns how many pixels of a photograph an LR sample covers along each side.

    A point must be smaller than a pixel of the truth, so for `point` the HR picture is the photograph at half its size.
    """
    return 2 * scale if kind == "point" else scale


def check_kind(kind: str, height: int, width: int, scale: int) -> None:
    """Raises `ValueError` if `kind` is not one of `KINDS`, or the photograph is smaller than a cell."""
    if kind not in KINDS:
        raise ValueError(f"degradation: no {kind!r} here; give one of {', '.join(KINDS)}")
    covered = cell_size(kind, scale)
    if min(height, width) < covered:
        raise ValueError(f"a picture of {height}x{width} is smaller than the {covered}x{covered} of one LR pixel")


def downscale_picture(kind: str, photograph: Picture, scale: int) -> Pair:
    """Makes LR and HR of a photograph `(H, W, C)`, 8 bit, cut to whole cells. Raises `ValueError` as `check_kind`.

    For `point` HR is the mean of each 2x2 pixels of the photograph, and LR that of the middle 2x2 of each cell.
    """
    height, width = photograph.shape[:2]
    check_kind(kind, height, width, scale)
    covered = cell_size(kind, scale)
    photograph = photograph[: height - height % covered, : width - width % covered]
    if kind == "bicubic":
        return Pair(_downscale_bicubic(photograph, scale), photograph)
    if kind == "box":
        return Pair(_average_cells(photograph, scale), photograph)
    return Pair(_sample_cells(photograph, covered), _average_cells(photograph, 2))


def downscale_crop(kind: str, photograph: Picture, scale: int, rows: slice, cols: slice) -> Pair:
    """Makes crops of the LR and HR that `downscale_picture` makes, bit for bit, but computes only the needed part."""
    margin, covered = MARGINS[kind], cell_size(kind, scale)
    height, width = (side // covered for side in photograph.shape[:2])
    top, left = max(0, rows.start - margin), max(0, cols.start - margin)
    bottom, right = min(height, rows.stop + margin), min(width, cols.stop + margin)
    part = photograph[top * covered : bottom * covered, left * covered : right * covered]
    inside = slice(rows.start - top, rows.stop - top), slice(cols.start - left, cols.stop - left)
    return crop_pair(downscale_picture(kind, part, scale), scale, *inside)


def crop_pair(pair: Pair, scale: int, rows: slice, cols: slice) -> Pair:
    """Crops LR to these rows and columns, and HR to the same part."""
    tall, wide = slice(rows.start * scale, rows.stop * scale), slice(cols.start * scale, cols.stop * scale)
    return Pair(pair.low[rows, cols], pair.high[tall, wide])


def _downscale_bicubic(picture: Picture, scale: int) -> Picture:
    """Downscales with Keys' cubic, a = -0.5, widened by `scale`. Pillow sums in float64, and halves are rounded up.

    At the border MATLAB mirrors the picture, while Pillow renormalises the kernel; the outermost 2 samples can differ.
    """
    size = (picture.shape[1] // scale, picture.shape[0] // scale)
    planes = [
        np.asarray(Image.fromarray(plane.astype(np.float32)).resize(size, Image.Resampling.BICUBIC))
        for plane in np.moveaxis(picture, 2, 0)
    ]
    return np.floor(np.stack(planes, axis=2) + np.float32(0.5)).clip(0, 255).astype(np.uint8)


def _average_cells(picture: Picture, scale: int) -> Picture:
    cells = _split_cells(picture, scale)
    total: NDArray[np.float32] = np.zeros_like(cells[:, 0, :, 0])  # (h, w, C)
    for row in range(scale):
        for col in range(scale):
            total += cells[:, row, :, col]
    return _to_bytes(np.divide(total, scale**2, dtype=np.float32))


def _sample_cells(picture: Picture, scale: int) -> Picture:
    """Computes the mean of the four samples around the middle of each cell. `scale` is even."""
    cells, after = _split_cells(picture, scale), scale // 2
    upper, lower = (cells[:, row, :, after - 1] + cells[:, row, :, after] for row in (after - 1, after))
    return _to_bytes(np.divide(upper + lower, 4, dtype=np.float32))


def _split_cells(picture: Picture, scale: int) -> NDArray[np.float32]:
    """Splits `(H, W, C)` into cells: `(H / scale, scale, W / scale, scale, C)` in [0, 1]."""
    height, width, channels = picture.shape
    values: NDArray[np.float32] = picture.astype(np.float32) / np.float32(255)
    return np.reshape(values, (height // scale, scale, width // scale, scale, channels))


def _to_bytes(values: NDArray[np.float32]) -> Picture:
    levels: Picture = np.rint(values * np.float32(255)).astype(np.uint8)
    return levels
