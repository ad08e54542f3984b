"""Accuracy on the public test sets by the published protocol, with `models` used as a user would."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from tqdm import tqdm

from ciir.errors import UnsuitedModel, UnsupportedScale
from ciir.models import catalogue
from ciir.models.cards import Accuracy, read_card
from ciir.models.single.network import SingleImageNetwork
from ciir.models.single.pixels import upscale_pixels
from ciir.training.data import pictures
from ciir.training.data.downscale import POINT, downscale_picture
from ciir.training.evaluation.metrics import average, compute_psnr, compute_ssim, convert_to_luma

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ciir.models.upscaler import Upscaler
    from ciir.training.data.pictures import Picture

PROTOCOL = (
    "Mean over the pictures of PSNR (dB) and SSIM of Y (ITU-R BT.601, studio range, not rounded, of 8-bit RGB; grey "
    "pictures are their own Y) after the output is rounded to 8 bits and a border of `scale` pixels is cut. LR: {low}. "
    "SSIM: Wang et al. 2004, 11x11 Gaussian window of sigma 1.5, valid region, K 0.01 and 0.03, L 255. "
    "The mean PSNR is that of pictures that aren't identical, if there are any."
)
PUBLISHED = frozenset({"Set5", "Set14", "BSD100", "Urban100"})
"""The names of SelfExSR's folders."""


def describe_protocol(folders: Iterable[Path], degradation: str = "") -> str:
    """Describes how the pictures of `folders` are scored, with LR made by `degradation`, or if it is empty as given."""
    if degradation:
        return PROTOCOL.format(low=f"{degradation}, to 8 bits" + f"; {POINT}" * (degradation == "point"))
    is_published = {folder.resolve().name for folder in folders} <= PUBLISHED
    supplied = "MATLAB's bicubic imresize, as supplied by SelfExSR"
    return PROTOCOL.format(low=supplied if is_published else "as given in the folder")


class Measured(NamedTuple):
    """Scores of a model on the pictures of a folder."""

    mean: Accuracy
    pictures: dict[str, tuple[float, float]]
    """Name of the HR file -> Y-PSNR (dB, infinite if nothing differs) and SSIM."""
    notes: tuple[str, ...] = ()
    """What was found while the pictures were read."""


def score(upscaler: Upscaler, folder: Path, *, degradation: str = "") -> Accuracy:
    """Returns the means of `measure`, and raises the same errors."""
    return measure(upscaler, folder, degradation=degradation).mean


def measure(upscaler: Upscaler, folder: Path, *, degradation: str = "") -> Measured:
    """Returns Y-PSNR and SSIM of each picture of `folder`, and their means, named after it. See
    `describe_protocol`.

    Without a `degradation` the mean is over the folder's `*_LR.png` and `*_HR.png` pairs. With `bicubic`, `box` or
    `point` it is over its `*_HR.png`, or if there are none over all its pictures (see
    `training.data.pictures.find_pictures`), with LR made by `training.data.downscale.downscale_picture`. 16-bit
    pictures are rounded to 8 bits. If none of the folder uses all 16 bits, they are scaled up first as if they did.

    Raises `ValueError` if there is no pair or picture, one can't be read or is too small to be scored, or an HR
    picture is missing or not `scale` times as large as its LR.
    """
    scores = {}
    for file, low, high in _degrade_pairs(folder, degradation, upscaler.scale) if degradation else _read_pairs(folder):
        picture = upscale_pixels(upscaler, low[np.newaxis])[0]
        if picture.shape != high.shape:
            raise ValueError(
                f"{file}: {high.shape[0]}x{high.shape[1]} pixels, but {upscaler.name} makes "
                f"{picture.shape[0]}x{picture.shape[1]} from its LR; name a folder of pairs at scale {upscaler.scale}"
            )
        got, truth = convert_to_luma(picture), convert_to_luma(high)
        try:
            ssim = compute_ssim(got, truth, border=upscaler.scale)
        except ValueError as error:
            raise ValueError(f"{file}: {error}; remove it from the folder") from error
        scores[file.name] = compute_psnr(got, truth, border=upscaler.scale), ssim
    name = folder.resolve().name  # that of `.` is empty
    data = f"{name} ({degradation})" if degradation else name
    return Measured(average(data, scores), scores)


def load_model(model: str, *, scale: int = 2) -> Upscaler:
    """Loads a model by its name in the catalogue, or an exported network by the path of its card.

    `auto` is the default. int8 is emulated if the processor doesn't support it.

    Raises `ciir.errors.ModelError` if there is no such model, it doesn't upscale by `scale`, or it is for light fields.
    """
    model = catalogue.picture_default_name() if model == "auto" else model
    if model.endswith(".json"):
        card = read_card(Path(model))
        if card.is_light_field:
            raise UnsuitedModel(f"{card.name} takes the views of a light field, not pictures; give --light-field")
        if card.scale != scale:
            raise UnsupportedScale(f"scale: {card.name} upscales by {card.scale}, not {scale}; give that")
        return SingleImageNetwork(Path(model), emulates_int8=True)
    return catalogue.load_upscaler(model, scale=scale, emulates_int8=True)


def _read_pairs(folder: Path) -> Iterator[tuple[Path, Picture, Picture]]:
    """Yields each HR file with the pixels of its LR file and its own."""
    pairs = pictures.pair_files(sorted(folder.glob("*_LR.png")))
    if not pairs:
        raise ValueError(
            f"{folder}: no *_LR.png in it; name a folder of *_LR.png and *_HR.png pairs, or give --degradation"
        )
    unused = pictures.count_unused(file for pair in pairs for file in pair)
    for low, high in tqdm(pairs, desc=folder.name, disable=None, unit="picture", leave=False):
        yield high, pictures.read_picture(low, unused=unused), pictures.read_picture(high, unused=unused)


def _degrade_pairs(folder: Path, kind: str, scale: int) -> Iterator[tuple[Path, Picture, Picture]]:
    """Yields each HR file with the pixels of its LR picture, which is made here, and of HR, `(H, W, 1 or 3)`."""
    files = pictures.find_pictures(folder)
    files = [file for file in files if file.name.endswith("_HR.png")] or files
    unused = pictures.count_unused(files)
    for file in tqdm(files, desc=folder.name, disable=None, unit="picture", leave=False):
        try:
            low, high = downscale_picture(kind, pictures.read_picture(file, unused=unused), scale)
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from error
        yield file, low, high
