"""Accuracy on the public test sets by the published protocol, through `models` as a user runs it. Needs no torch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image
from tqdm import tqdm

from models.card import Accuracy
from models.catalogue import load
from models.metrics import luma, psnr, ssim
from models.pixels import upscale_pixels
from models.session import Network

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.upscaler import Upscaler

PROTOCOL = (
    "Mean over the pictures of PSNR (dB) and SSIM of Y (ITU-R BT.601, studio range, not rounded, of 8-bit RGB; grey "
    "pictures are their own Y) after the output is rounded to 8 bits and a border of `scale` pixels is cut. LR: "
    "MATLAB's bicubic imresize, as supplied by SelfExSR. SSIM: Wang et al. 2004, 11x11 Gaussian window of sigma 1.5, "
    "valid region, K 0.01 and 0.03, L 255."
)


def evaluate(upscaler: Upscaler, folder: Path) -> Accuracy:
    """Mean Y-PSNR and SSIM over the `*_LR.png` and `*_HR.png` pairs of `folder`, named after it. See `PROTOCOL`.

    Raises `ValueError` where there is no pair, or an HR picture is missing or not `scale` times as large as its LR.
    """
    psnrs, ssims = [], []
    for low_file in tqdm(low_files(folder), desc=folder.name, disable=None, unit="picture", leave=False):
        high_file = low_file.with_name(low_file.name.replace("_LR.png", "_HR.png"))
        if not high_file.is_file():
            raise ValueError(f"{high_file}: missing; each *_LR.png needs its *_HR.png")
        low, high = read_picture(low_file), read_picture(high_file)
        picture = upscale_pixels(upscaler, low[np.newaxis])[0]
        if picture.shape != high.shape:
            raise ValueError(
                f"{high_file}: {high.shape[0]}x{high.shape[1]} pixels, where {upscaler.name} makes "
                f"{picture.shape[0]}x{picture.shape[1]} of its LR; name a folder of pairs at scale {upscaler.scale}"
            )
        got, truth = _luma(picture), _luma(high)
        psnrs.append(psnr(got, truth, border=upscaler.scale))
        ssims.append(ssim(got, truth, border=upscaler.scale))
    return Accuracy(folder.name, len(psnrs), round(float(np.mean(psnrs)), 4), round(float(np.mean(ssims)), 5))


def evaluate_folder(model: str, folder: Path, *, scale: int = 2) -> Accuracy:
    """`evaluate` for a model by its name in the catalogue, or for any exported network by the path of its card.

    Raises `models.errors.ModelError` where there is no such model, and `ValueError` as `evaluate` does.
    """
    if model.endswith(".json"):
        return evaluate(Network(Path(model)), folder)
    return evaluate(load(model, scale=scale), folder)


def low_files(folder: Path) -> list[Path]:
    """The `*_LR.png` in `folder`, sorted by name. Raises `ValueError` where there is none."""
    files = sorted(folder.glob("*_LR.png"))
    if not files:
        raise ValueError(f"{folder}: no *_LR.png in it; name a folder of *_LR.png and *_HR.png pairs")
    return files


def read_picture(path: Path) -> NDArray[np.uint8]:
    """8 bit, `(H, W, 1)` grey or `(H, W, 3)` RGB. Raises `ValueError` where the PNG can't be read."""
    try:
        with Image.open(path, formats=("PNG",)) as image:
            pixels = np.asarray(image if image.mode == "L" else image.convert("RGB"))
    except (OSError, SyntaxError) as error:
        raise ValueError(f"{path}: not a PNG that can be read; give it again") from error
    return pixels[..., np.newaxis] if pixels.ndim == 2 else pixels


def _luma(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """As the published scripts have it: grey isn't squeezed into the studio range, which would add 1.3 dB."""
    return luma(picture) if picture.shape[2] == 3 else picture[..., 0].astype(np.float64)
