"""Converts other numbers to levels of 8 and 16 bits, and takes colours without alpha."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ciir.bit_depth import raise_levels
from ciir.errors import Unreadable

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels

Number = TypeVar("Number", bound=np.generic)

ROUNDED = "samples are floating-point numbers, rounded to 16 bit"
"""The note on floating-point samples."""
MARGIN = 0.49 / 65535
"""How far samples may lie outside 0 and 1, as they do by rounding: the nearest level is still the last one."""
LEVELS = 2
"""Floating-point samples over this are levels of 8 or 16 bits, as `advise_levels` treats them."""


def round_levels(picture: NDArray[np.float32], dtype: np.dtype[Any]) -> Pixels:
    """Returns the levels of `dtype`, uint8 or uint16, nearest to `picture`, of any shape."""
    levels: Pixels = np.rint(picture).clip(0, np.iinfo(dtype).max).astype(dtype)
    return levels


def drop_alpha(pixels: NDArray[Number]) -> NDArray[Number]:
    """Returns pixels `(..., C)`, 1 to 4 channels, without alpha: `(..., 1)` or `(..., 3)`."""
    return pixels[..., : 1 if pixels.shape[-1] < 3 else 3]


def round_to_8_bit(picture: Pixels, unused: int) -> NDArray[np.uint8]:
    """Returns `picture` of any shape `(..., C)` in 8 bits; a 16-bit one is raised by `unused` bits first."""
    if picture.dtype == np.uint8:
        return picture.astype(np.uint8, copy=False)
    rounded: NDArray[np.uint8] = (raise_levels(picture, unused) / 257).round().astype(np.uint8)
    return rounded


def note_rounding(name: str, dtype: np.dtype[Any], unused: int) -> list[str]:
    """Returns notes on views of `dtype` in the 8 bits of the format `name`, raised by `unused` bits of
    `ciir.bit_depth.count_unused_camera_bits`; none for uint8.
    """
    return [f"{name}: 16 bits are rounded to 8", *note_raising(name, unused)] if dtype == np.uint16 else []


def note_raising(name: str, unused: int) -> list[str]:
    """Returns notes on views whose levels the format `name` raises by `unused` bits; none for 0."""
    if not unused:
        return []
    return [f"{name}: no level is over {2 ** (16 - unused) - 1}, so levels are multiplied by {2**unused}"]


def round_samples(
    picture: NDArray[np.floating[Any]], what: str, whole: NDArray[np.floating[Any]] | None = None
) -> NDArray[np.uint16]:
    """Returns samples from 0 to 1, of any shape, as 16 bits. `whole`: all pictures, which decide the remedy.

    Raises `Unreadable`, whose message starts with `what`, for samples that are not from 0 to 1.
    """
    low, high = float(picture.min()), float(picture.max())
    if not (low >= -MARGIN and high <= 1 + MARGIN):  # false for NaN, too
        found = "samples that are NaN" if np.isnan(low) else f"samples from {low:.7g} to {high:.7g}"
        whole = picture if whole is None else whole
        cleaned = "np.nan_to_num(array)" if np.isnan(whole.min()) else "array"
        advice = f"such as {cleaned}.clip(0, 1), or uint8 or uint16"
        if find_range(whole)[1] > LEVELS:
            advice = f"or uint8 or uint16, as in {advise_levels(whole, 'array')}"
        raise Unreadable(f"{what} has {found}; give floating-point numbers from 0 to 1, {advice}")
    rounded = np.empty(picture.shape, np.uint16)
    white = picture.dtype.type(65535) if picture.itemsize > 2 else np.float32(65535)
    np.rint(picture * white, casting="unsafe", out=rounded)
    return rounded


def advise_levels(views: Any, name: str = "views") -> str:
    """Returns code on a variable `name` that makes 8 or 16 bits of `views`, judged by their range: shares of white or
    levels.

    Resampled numbers lie a little outside their range, so floating-point ones belong to a range up to twice its end.
    NaN becomes black, and complex numbers become their absolute values.
    """
    if not isinstance(views, np.ndarray) or views.dtype.kind == "b" or not views.size:
        return f"(255 * {name}).round().astype('u1')"
    if views.dtype.kind not in "iufc":
        return f"{name}.astype('u1')"
    if views.dtype.kind == "c":
        views, name = np.abs(views), f"np.abs({name})"
    low, high = find_range(views)
    is_finite = bool(np.isfinite(views).all())
    if np.isnan(views.min()):
        name = f"np.nan_to_num({name})"
    beyond = 2 if views.dtype.kind == "f" else 1
    white = 255 if high <= 255 * beyond else 65535
    if high <= beyond:
        clipped = name if is_finite and low >= 0 and high <= 1 else f"{name}.clip(0, 1)"
        return f"(255 * {clipped}).round().astype('u1')"
    clipped = name if is_finite and low >= 0 and high <= white else f"{name}.clip(0, {white})"
    return f"{clipped}.round().astype('u{1 if white == 255 else 2}')"


def find_range(samples: NDArray[Any]) -> tuple[float, float]:
    """Returns the smallest and the largest of the finite numbers in `samples`, of any shape; 0 and 0 without any."""
    finite = np.isfinite(samples)
    if not finite.any():
        return 0.0, 0.0
    if finite.all():
        return float(samples.min()), float(samples.max())
    kept = samples[finite]
    return float(kept.min()), float(kept.max())
