"""Scores of results against their truth: pictures, light fields and disparity maps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.bit_depth import count_unused_bits
from ciir.errors import InputError
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers import pictures
from ciir.renderer.readers.registry import is_picture
from ciir.training.data.light_field.views import convert_views, drop_alpha, read_light_field
from ciir.training.evaluation.light_fields import Measured
from ciir.training.evaluation.metrics import (
    SSIM_RADIUS,
    MapScore,
    average,
    compute_psnr,
    compute_ssim,
    convert_to_luma,
    score_map,
)

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from ciir.renderer.readers.layout import Layout

MAPS = frozenset({".pfm", ".npy"})
"""Suffixes of disparity maps that are read here."""
CLOSER = 1.0
"""By how many dB a view must be closer to the opposite view of the truth for a note."""
PROTOCOL = (
    "Mean over the views, or of the one picture, of PSNR (dB) and SSIM of Y (ITU-R BT.601, studio range, not rounded, "
    "of 8-bit RGB; grey is its own Y) after rounding to 8 bits; a border of `scale` pixels is cut. SSIM: Wang et al. "
    "2004, 11x11 Gaussian window of sigma 1.5, valid region, K 0.01 and 0.03, L 255. Disparity maps: BadPix(0.07), the "
    "share of pixels whose disparity is off by more than 0.07, and 100 times the mean square error, as in the HCI 4D "
    "light field benchmark, over the pixels that are finite in the truth."
)


def is_map(path: Path) -> bool:
    """Returns whether `path` names a disparity map: a PFM, or an NPY with two axes."""
    if path.suffix.lower() not in MAPS or not path.is_file():
        return False
    return path.suffix.lower() == ".pfm" or np.load(path, mmap_mode="r", allow_pickle=False).ndim == 2


def compare_maps(result: Path, truth: Path) -> MapScore:
    """Scores the disparity map `result`; both in pixels per view, in the same sense.

    Raises `ValueError` if one can't be read, their sizes differ, or the truth has no finite pixel.
    """
    found, true = _read_map(result), _read_map(truth)
    if found.shape != true.shape:
        raise ValueError(f"{result}: {_size(found)} pixels, but {truth} has {_size(true)}; give maps of one size")
    if not np.isfinite(true).any():
        raise ValueError(f"{truth}: no pixel is finite; give a disparity map")
    return score_map(found, true)


def compare_views(result: Path, truth: Path, *, border: int, layout: Layout | None = None) -> Measured:
    """Scores each view of `result`, a picture or a light field, against that of `truth`, of the same size.

    A border of `border` pixels is cut. `layout`: how views lie in both files, if the caller knows; pictures are then
    read as light fields. If views are counted from other ends in the two files, they are compared in the same order.

    Raises `ValueError` if one can't be read, or their views differ in number, size or channels.
    """
    found, true = (_read_views(path, layout) for path in (result, truth))
    notes = [*found.notes, *(note for note in true.notes if note not in found.notes)]
    if found.depth_sense != true.depth_sense and found.views.shape[:2] != (1, 1):
        found = found.flip("uv")
        notes.append(f"views of {result.name} are counted from the other end than those of {truth.name}: put right")
    made, wanted = found.views, true.views
    if made.shape != wanted.shape:
        raise ValueError(
            f"{result}: {_describe(made)}, but {truth} has {_describe(wanted)}; give views of the same number and size"
        )
    if min(wanted.shape[2:4]) - 2 * border <= 2 * SSIM_RADIUS:
        raise ValueError(f"{truth}: {_describe(wanted)}; SSIM needs more than {2 * (SSIM_RADIUS + border)} each way")
    made, wanted = _round_to_8_bits(made, wanted)
    scores = {}
    for v, u in np.ndindex(made.shape[:2]):
        got, best = convert_to_luma(made[v, u]), convert_to_luma(wanted[v, u])
        scores[v, u] = compute_psnr(got, best, border=border), compute_ssim(got, best, border=border)
    if len(scores) > 1:
        opposite = compute_psnr(convert_to_luma(made[0, 0]), convert_to_luma(wanted[-1, -1]), border=border)
        if opposite > scores[0, 0][0] + CLOSER:
            notes.append(
                f"view 0,0 of {result.name} is closer to the last view of {truth.name} than to its first: one of them "
                "may count views from the other end; convert it with flip uv"
            )
    return Measured(average(result.name, scores), scores, tuple(notes))


def _read_map(path: Path) -> NDArray[np.float64]:
    from PIL import Image  # it reads PFM, and turns it upright

    try:
        if path.suffix.lower() == ".npy":
            found = np.load(path, allow_pickle=False)
        else:
            with Image.open(path, formats=("PPM",)) as image:
                found = np.asarray(image)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: not a disparity map that is read ({error}); give a .pfm or .npy") from error
    if found.ndim != 2 or found.dtype.kind != "f":
        raise ValueError(f"{path}: {found.dtype} of shape {found.shape}; give a disparity map, (H, W) of floats")
    return np.asarray(found, np.float64)


def _read_views(path: Path, layout: Layout | None) -> LightField:
    if layout is None and path.is_file() and is_picture(path.name):
        try:
            pixels = pictures.decode(path.read_bytes(), name=path.name, max_pixels=DEFAULT_LIMITS.pixels)
        except InputError as error:
            raise ValueError(f"{path}: {str(error).removeprefix(f'{path.name}: ')}") from error
        return drop_alpha(LightField(pixels[None, None], is_ordered=True), path)
    return read_light_field(path, layout=layout, least=1)


def _round_to_8_bits(*both: NDArray[Any]) -> list[NDArray[np.uint8]]:
    """Returns arrays of views with 8 bits. Those of 16 bits are scaled up alike, by the bits that neither uses."""
    unused = min((count_unused_bits(views) for views in both if views.dtype == np.uint16), default=0)
    return [convert_views(views, keeps_grey=True, unused=unused) for views in both]


def _describe(views: NDArray[Any]) -> str:
    rows, cols, height, width, channels = views.shape
    of_what = f"{rows}x{cols} views of " if (rows, cols) != (1, 1) else ""
    return f"{of_what}{height}x{width} pixels, {'grey' if channels == 1 else f'{channels} channels'}"


def _size(plane: NDArray[Any]) -> str:
    return "x".join(map(str, plane.shape))
