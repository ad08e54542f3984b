"""Cases of single pictures: degradation, noise and JPEG.

- bicubic and box: clean, one of noise (sigma 2, 5, 10) and JPEG (95, 90, 75, 50, 30), and both together (noise of 2
  with JPEG of 90, 5 with 75), as in files of cameras;
- point: clean.

Pictures are cropped to their middle before they are degraded (`training.data.downscale`).
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ciir.benchmarks.bench.work import reconstruct_views
from ciir.benchmarks.harm.case import PICTURE, SCALE, Case
from ciir.benchmarks.harm.light_fields import LEAST, Variation, corrupt_views
from ciir.errors import InvalidOption
from ciir.renderer.readers.registry import is_picture
from ciir.service.pipeline.options import Options
from ciir.training.data.downscale import downscale_picture
from ciir.training.evaluation.folders import read_picture

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ciir.benchmarks.harm.case import Picture
    from ciir.renderer.readers.bundle import Bundle

SIGMAS = (2, 5, 10)
"""Standard deviations of Gaussian noise, 8-bit levels."""
QUALITIES = (95, 90, 75, 50, 30)
"""JPEG qualities, with chroma at half size."""
BOTH = ((2, 90), (5, 75))
"""Noise and JPEG together."""
SIDE = 512
"""Largest side of a picture, in pixels, before it is degraded; larger pictures are cropped to their middle."""
FACTORS = ("degradation", "noise", "jpeg")
"""Factors of a variation that a picture has."""
HIGH = "_HR.png"
"""The end of names of high-resolution pictures; other pictures in a folder with such names are left out."""
LINES = ("Integral imaging", "records rays, not", "only light: 0.4 mm", "(pitch), f = 3.0 mm", "Waffle & AVAIL 17%")
"""Text of a drawn picture."""


def list_variations(*, quick: bool = False) -> list[Variation]:
    """Lists the cases of a picture, as described at the head of this module. `quick`: only a few."""
    view = (1, 1)
    if quick:
        clean = [Variation(kind, view) for kind in ("bicubic", "box", "point")]
        return [*clean, Variation("box", view, noise=SIGMAS[-1]), Variation("box", view, jpeg=QUALITIES[-1])]
    corruptions = [(0, 0), *((sigma, 0) for sigma in SIGMAS), *((0, quality) for quality in QUALITIES), *BOTH]
    found = [
        Variation(kind, view, noise=sigma, jpeg=quality)
        for kind, (sigma, quality) in product(("bicubic", "box"), corruptions)
    ]
    return [*found, Variation("point", view)]


def list_cases(name: str, picture: Picture, variations: Sequence[Variation]) -> Iterator[Case]:
    """Yields the cases of `picture`, the input `name`. Each is a light field of one view, which is what `ciir.upscale`
    makes of a picture.
    """
    for number, one in enumerate(variations):
        low, high = downscale_picture(one.degradation, picture, SCALE)
        made = corrupt_views(low[np.newaxis, np.newaxis], one, np.random.default_rng(number))
        yield Case(
            input=name,
            kind=PICTURE,
            factors={factor: text for factor, text in one.describe().items() if factor in FACTORS},
            views=made.views.astype(np.uint8),
            at=(0, 0),
            truth=high,
            border=SCALE,
            source=made,
            options=Options(views="all", scale=SCALE),
        )


def list_photographs(source: Bundle) -> list[str]:
    """Lists the pictures of `source`: the file that was given; or all of a folder or zip, and if there are any whose
    names end with `HIGH`, only these.
    """
    keys = [source.main] if source.main is not None else sorted(filter(is_picture, source.files))
    return [key for key in keys if key.endswith(HIGH)] or keys


def read_photographs(name: str, source: Bundle) -> dict[str, Picture]:
    """Reads the pictures of the input `name` as 8-bit RGB, cropped to their middle: name -> picture.

    Raises `InvalidOption` if there is none, or one is smaller than `LEAST`, can't be read, or is see-through.
    """
    found = {}
    for key in list_photographs(source):
        try:
            view = read_picture(source.files[key], Path(name, key))
        except ValueError as error:
            raise InvalidOption(str(error)) from error
        picture = reconstruct_views(view, Options(views="all", model="none", scale=1))[0][0]
        if min(picture.shape[:2]) < LEAST:
            size = f"{picture.shape[0]}x{picture.shape[1]}"
            raise InvalidOption(f"{name}/{key}: {size} pixels; give pictures of {LEAST}x{LEAST} or more")
        top, left = (max(0, length - SIDE) // 2 for length in picture.shape[:2])
        found[f"{name}/{key.removesuffix(HIGH)}"] = picture[top : top + SIDE, left : left + SIDE]
    if not found:
        raise InvalidOption(f"{name}: no picture in it; give a folder of photographs")
    return found


def draw_pictures(*, quick: bool) -> dict[str, Picture]:
    """Draws a view of the globe and lines of text, which stand for photographs if no picture is given: name -> picture
    of 512x512, with `quick` 128x128.
    """
    side = 128 if quick else SIDE
    options = Options(
        lenses=(side, side), pixels=(1, 1), sampling="lenslet", background=(80, 80, 80), model="none", scale=1
    )
    sheet = Image.new("RGB", (side, side), (250, 246, 236))
    pen = ImageDraw.Draw(sheet)
    for number, line in enumerate(LINES):
        place = side // 32, number * side // len(LINES)
        pen.text(place, line, (30, 30, 60 * (number % 3)), ImageFont.load_default(side / 10))
    return {"drawn globe": reconstruct_views("globe", options)[0][0], "drawn text": np.array(sheet)}
