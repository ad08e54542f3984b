"""Degradation of training pictures in torch: low-resolution pictures from high-resolution ones, with exact phase.

LR sample i lies between HR samples 2i and 2i+1 (area resampling, `align_corners=False`): the geometry of a lens array
whose pitch is twice as wide over the same extent. Half a pixel of error here costs 2 to 4 dB.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch.nn import functional

from ciir.training.data.downscale import cell_size, check_kind

if TYPE_CHECKING:
    from torch import Tensor


Pair = tuple["Tensor", "Tensor"]
"""LR `(C, h, w)` and HR `(C, scale*h, scale*w)`, 8 bit."""
MARGINS = {"bicubic": 2, "box": 0, "point": 0}
"""How many LR samples around a crop its LR depends on: the bicubic kernel ends 2 LR samples away."""


def bicubic(image: Tensor, scale: int) -> Tensor:
    """MATLAB's `imresize(image, 1/scale)`: the field's published protocol.

    `image`: `(N, C, scale*H, scale*W)` float in [0, 1]. Returns `(N, C, H, W)`, clamped to [0, 1] and rounded to 8
    bits as the published LR pictures are. The kernel is Keys' cubic with a = -0.5, widened by `scale` (antialiased).
    MATLAB mirrors the picture at its border where torch renormalises the kernel: the outermost 2 samples can differ.

    Raises `ValueError` where the size is not a multiple of `scale`.
    """
    height, width = image.shape[-2:]
    _check_multiple(height, width, scale)
    small = functional.interpolate(
        image, size=(height // scale, width // scale), mode="bicubic", align_corners=False, antialias=True
    )
    return _to_8_bit(small)


def box(image: Tensor, scale: int) -> Tensor:
    """The mean over each `scale x scale` cell, as a lenslet samples. Shapes, range and errors as `bicubic`'s."""
    _check_multiple(image.shape[-2], image.shape[-1], scale)
    return _to_8_bit(functional.avg_pool2d(image, scale))


def point(image: Tensor, scale: int) -> Tensor:
    """The middle of each `scale x scale` cell, as a pinhole samples. Shapes, range and errors as `bicubic`'s.

    Where `scale` is even, it is the mean of the four samples around the middle.
    """
    cells = _cells(image, scale)
    middle = slice((scale - 1) // 2, scale // 2 + 1)
    return _to_8_bit(cells[:, :, :, middle, :, middle].mean((3, 5)))


def make_pair(kind: str, photograph: Tensor, scale: int) -> Pair:
    """Degrades a photograph `(C, H, W)`, 8 bit, cut to whole cells: returns LR and HR.

    Raises `ValueError` as `training.data.downscale.check_kind`.
    """
    check_kind(kind, photograph.shape[-2], photograph.shape[-1], scale)
    covered = cell_size(kind, scale)
    high = crop_to_multiple(photograph[None].float().div(255.0), covered)
    if kind == "point":
        low, high = point(high, covered), box(high, 2)
    else:
        low = {"bicubic": bicubic, "box": box}[kind](high, scale)
    return _as_bytes(low[0]), _as_bytes(high[0])


def make_crop(kind: str, photograph: Tensor, scale: int, rows: slice, cols: slice) -> Pair:
    """Crops LR and HR as `make_pair` computes them, bit for bit, and degrades only what the crop needs."""
    margin, covered = MARGINS[kind], cell_size(kind, scale)
    height, width = (side // covered for side in photograph.shape[-2:])
    top, left = max(0, rows.start - margin), max(0, cols.start - margin)
    bottom, right = min(height, rows.stop + margin), min(width, cols.stop + margin)
    low, high = make_pair(
        kind, photograph[:, top * covered : bottom * covered, left * covered : right * covered], scale
    )
    inside = (slice(rows.start - top, rows.stop - top), slice(cols.start - left, cols.stop - left))
    return crop_pair(low, high, scale, *inside)


def crop_pair(low: Tensor, high: Tensor, scale: int, rows: slice, cols: slice) -> Pair:
    """Crops an LR picture to these rows and columns, and HR to match."""
    tall, wide = slice(rows.start * scale, rows.stop * scale), slice(cols.start * scale, cols.stop * scale)
    return low[:, rows, cols], high[:, tall, wide]


def _as_bytes(image: Tensor) -> Tensor:
    return image.mul(255.0).round().to(torch.uint8)


def _cells(image: Tensor, scale: int) -> Tensor:
    """`(N, C, H, scale, W, scale)`."""
    count, channels, height, width = image.shape
    _check_multiple(height, width, scale)
    return image.reshape(count, channels, height // scale, scale, width // scale, scale)


def _check_multiple(height: int, width: int, scale: int) -> None:
    if height % scale or width % scale:
        raise ValueError(f"a picture of {height}x{width} is not a multiple of the scale {scale}: crop it first")


def _to_8_bit(image: Tensor) -> Tensor:
    return image.clamp(0.0, 1.0).mul(255.0).round().div(255.0)


def crop_to_multiple(image: Tensor, scale: int) -> Tensor:
    """The largest top-left part of `(..., H, W)` whose sides are multiples of `scale` (MATLAB protocol's `modcrop`)."""
    height, width = image.shape[-2:]
    return image[..., : height - height % scale, : width - width % scale]


def to_tensor(pixels: Tensor) -> Tensor:
    """8-bit `(H, W, 3)` -> float `(1, 3, H, W)` in [0, 1]."""
    return pixels.permute(2, 0, 1).unsqueeze(0).float().div(255.0)
