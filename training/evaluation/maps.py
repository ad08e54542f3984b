"""Scores of disparity maps, in the formats that `ciir depth` writes (`renderer.writers.depth.maps`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.writers.depth.maps import CONFIDENCE
from ciir.training.evaluation.metrics import MapScore, score_map

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SUFFIXES = (".pfm", ".npy", ".png", ".tif", ".tiff")
"""Suffixes of disparity maps that are read here."""


def is_map(path: Path) -> bool:
    """Returns whether `path` is a disparity map: a PFM, an NPY of floats with two axes, a TIFF of floats with one page
    and one channel, or a PNG of 16 bits with the text chunks `offset` and `scale`.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES or not path.is_file():
        return False
    try:
        return suffix == ".pfm" or bool(read_map(path).size)
    except ValueError:
        return False


def compare_maps(result: Path, truth: Path) -> tuple[MapScore, tuple[str, ...]]:
    """Scores the disparity map `result`, and returns notes on pixels without a value; both in pixels per view, in the
    same sense.

    Pixels count if they are finite in `truth` and its confidence isn't 0 there. That is read from the file that
    `ciir depth` writes beside a map, `NAME_confidence`, if there is one; it is 0 where no mesh is seen.

    Raises `ValueError` if one can't be read, their sizes differ, or no pixel of the truth counts.
    """
    if not result.is_file():
        what = "a folder" if result.is_dir() else "no such file"
        raise ValueError(f"{result}: {what}; {truth} is a disparity map, so give one")
    found, true = read_map(result), read_map(truth)
    beside = truth.with_stem(truth.stem + CONFIDENCE)
    _check_size(result, found, truth, true)
    reasons = [f"{unknown:,} without a finite value"] if (unknown := np.count_nonzero(~np.isfinite(true))) else []
    if beside.is_file():
        confidence = read_map(beside)
        _check_size(beside, confidence, truth, true)
        left_out = np.isfinite(true) & (confidence == 0)
        true[left_out] = np.nan
        if left_out.any():
            reasons.append(f"{left_out.sum():,} with the confidence 0 in {beside.name}")
    if not np.isfinite(true).any():
        why = "is finite with a confidence above 0" if beside.is_file() else "is finite"
        raise ValueError(f"{truth}: no pixel {why}; give a disparity map")
    score = score_map(found, true)
    notes = []
    if reasons:
        left = " and ".join(reasons)
        notes = [f"{score.pixels:,} of {true.size:,} pixels of {truth.name} count; {left} are left out"]
    if score.not_finite:
        notes.append(
            f"pixels of {result.name} without a finite value: {score.not_finite:,}; they count as bad, but not in the "
            "mean square error"
        )
    return score, tuple(notes)


def read_map(path: Path) -> NDArray[np.float64]:
    """Reads a map, `(H, W)`, of the kinds named at `is_map`. Raises `ValueError` for other files."""
    try:
        found = _read(path)
    except Exception as error:  # readers raise many kinds for corrupt files
        raise ValueError(
            f"{path}: not a disparity map that is read ({error}); give one of {', '.join(SUFFIXES)}"
        ) from error
    if found is None:
        raise ValueError(
            f"{path}: not a disparity map; give an NPY or a TIFF of floats, (H, W), a PFM, or a PNG of 16 bits with "
            "the text chunks offset and scale"
        )
    return found


def _read(path: Path) -> NDArray[np.float64] | None:
    """Reads a map, or returns None if the file is none."""
    suffix = path.suffix.lower()
    if suffix in (".tif", ".tiff"):
        import tifffile

        with tifffile.TiffFile(path) as file:
            return _keep_map(file.pages.first.asarray(maxworkers=1)) if len(file.pages) == 1 else None
    if suffix == ".npy":
        return _keep_map(np.load(path, mmap_mode="r", allow_pickle=False))
    from PIL import Image  # it turns PFM upright

    with Image.open(path, formats=("PNG",) if suffix == ".png" else ("PPM",)) as image:
        if suffix == ".pfm":
            return _keep_map(np.asarray(image))
        if image.mode != "I;16" or not {"scale", "offset"} <= image.info.keys():
            return None
        return float(image.info["offset"]) + float(image.info["scale"]) * np.asarray(image, np.float64)


def _keep_map(array: NDArray[Any]) -> NDArray[np.float64] | None:
    return array.astype(np.float64) if array.ndim == 2 and array.dtype.kind == "f" else None


def _check_size(path: Path, plane: NDArray[np.float64], truth: Path, true: NDArray[np.float64]) -> None:
    if plane.shape != true.shape:
        sizes = ["x".join(map(str, each.shape)) for each in (plane, true)]
        raise ValueError(f"{path}: {sizes[0]} pixels, but {truth} has {sizes[1]}; give maps of one size")
