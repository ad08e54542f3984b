"""Cases of light fields: degradation, grid, view, noise, JPEG and order of the views.

All combinations would be too many, so factors vary around the middle view of a clean 5x5 grid in the right order:

- degradation x grid (3x3, 5x5, 9x9, all views) x view (middle, edge, corner);
- degradation x one of noise (sigma 2, 5), JPEG (90, 75) and order (reversed, transposed) x view (middle, corner);
- for box only: two views exchanged; all views moved; all views rolled; noise and JPEG together; order with noise, order
  with JPEG; noise, JPEG and order on 3x3; order on up to 9x9; JPEG of the elemental image array that up to 9x9 views
  make (quality 90, 75; middle, corner).

Views are cropped to their middle before they are degraded (`training.data.downscale`). The truth is the view as it was
read. JPEG compresses each view, or the whole elemental image array if the input is one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np
from PIL import Image

from ciir.benchmarks.bench.work import reconstruct_views
from ciir.benchmarks.harm.case import LIGHT_FIELD, SCALE, Case
from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.service.pipeline.options import Options
from ciir.training.data import downscale
from ciir.training.data.corrupt import compress_jpeg
from ciir.training.data.light_field.views import compress_array, degrade_views

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ciir.benchmarks.harm.case import Views
    from ciir.renderer.views import View
    from ciir.service.pipeline.source import Source

Order = Literal["right", "reversed", "transposed", "exchanged", "moved", "rolled"]

GRIDS = (3, 5, 9)
PLACES = ("middle", "edge", "corner")
SIGMAS = (2, 5)
"""Standard deviations of Gaussian noise, 8-bit levels."""
QUALITIES = (90, 75)
"""JPEG qualities, with chroma at half size."""
ORDERS: tuple[Order, ...] = ("reversed", "transposed")
"""Wrong orders of views: rows from the bottom; rows and columns exchanged."""
ERRORS: tuple[Order, ...] = ("exchanged", "moved", "rolled")
"""Errors in the views' places: those beside the middle one are exchanged; each is moved by up to half an LR pixel; each
is turned about its middle by up to `ROLL`."""
ROLL = 0.5
"""Degrees by which rolled views are turned at most: at the edge of 128x128 LR pixels that is half an LR pixel."""
SIDE = 128
"""Largest side of a low-resolution view, in pixels; larger views are cropped to their middle."""
LEAST = 32
"""Smallest side of an input's views, in pixels: SSIM needs 11 pixels inside the border of the truth of `point`, which
is half as large."""
DRAWN = "drawn"
"""Name of the light field that is rendered from a shipped scene if no light field is given."""


@dataclass(frozen=True)
class Variation:
    """How a case is made from a light field."""

    degradation: str
    grid: tuple[int, int]
    """Views down and across: the middle ones of the input."""
    place: str = "middle"
    noise: int = 0
    jpeg: int = 0
    """Quality; 0 for no JPEG."""
    is_interleaved: bool = False
    """Whether JPEG compresses the elemental image array rather than each view."""
    order: Order = "right"

    def describe(self) -> dict[str, str]:
        """Returns every factor as text."""
        jpeg = f"{self.jpeg} interleaved" if self.is_interleaved else str(self.jpeg)
        return {
            "degradation": self.degradation,
            "grid": f"{self.grid[0]}x{self.grid[1]}",
            "view": self.place,
            "noise": str(self.noise),
            "jpeg": jpeg if self.jpeg else "none",
            "order": self.order,
        }

    @property
    def view(self) -> View:
        """Row and column of the wanted view in the right order; the edge is the upper one."""
        rows, cols = self.grid
        return {"middle": (rows // 2, cols // 2), "edge": (0, cols // 2), "corner": (0, 0)}[self.place]


def list_variations(counts: tuple[int, int], *, is_array: bool = False, quick: bool = False) -> list[Variation]:
    """Lists the cases of a light field of `counts` = (V, U) views, as described at the head of this module.

    `is_array`: whether it was read from an elemental image array. `quick`: only a few cases, on 5x5 or all views.
    """
    grids = list(dict.fromkeys([*((n, n) for n in GRIDS if n <= min(counts)), counts]))
    base = (5, 5) if (5, 5) in grids else counts
    widest = max((grid for grid in grids if max(grid) <= GRIDS[-1]), default=base)
    found: list[Variation] = []
    for kind in downscale.KINDS:
        plain = Variation(kind, base)
        twice = [replace(plain, place=place) for place in ("middle", "corner")]
        if quick:
            found += twice
            continue
        found += [Variation(kind, grid, place) for grid, place in product(grids, PLACES)]
        found += [replace(one, noise=sigma) for one, sigma in product(twice, SIGMAS)]
        found += [replace(one, jpeg=quality) for one, quality in product(twice, QUALITIES)]
        found += [replace(one, order=order) for one, order in product(twice, ORDERS)]
    plain = Variation("box", base)
    interleaved = replace(plain, grid=widest, is_interleaved=True)
    if quick:
        found += [replace(plain, noise=SIGMAS[-1]), replace(plain, jpeg=QUALITIES[-1])]
        found += [*(replace(plain, order=order) for order in ORDERS), replace(interleaved, jpeg=QUALITIES[-1])]
    else:
        small = replace(plain, grid=grids[0])
        if min(base) >= GRIDS[0]:
            found += [replace(plain, place=place, order=order) for place in ("middle", "corner") for order in ERRORS]
        found += [replace(plain, noise=sigma, jpeg=quality) for sigma, quality in zip(SIGMAS, QUALITIES, strict=True)]
        found += [replace(small, noise=SIGMAS[-1]), replace(small, jpeg=QUALITIES[-1])]
        found += [replace(one, order=order) for one in (small, replace(plain, grid=widest)) for order in ORDERS]
        found += [replace(plain, order="transposed", noise=SIGMAS[-1])]
        found += [replace(plain, order="reversed", jpeg=QUALITIES[-1])]
        found += [replace(interleaved, jpeg=q, place=place) for q, place in product(QUALITIES, ("middle", "corner"))]
    if is_array:
        found = [replace(one, is_interleaved=bool(one.jpeg)) for one in found]
    return list(dict.fromkeys(found))


def list_cases(name: str, views: Views, variations: Sequence[Variation]) -> Iterator[Case]:
    """Yields the cases of the light field `views`, which the input `name` holds."""
    for kind in dict.fromkeys(one.degradation for one in variations):
        cropped = crop_views(views, kind)
        pairs = {"right": degrade_views(cropped, kind, SCALE)}
        for order, change in (("moved", move_views), ("rolled", roll_views)):
            if any(one.order == order for one in variations if one.degradation == kind):
                pairs[order] = degrade_views(change(cropped, np.random.default_rng(0)), kind, SCALE)
        for number, one in enumerate(variations):
            if one.degradation != kind:
                continue
            part, true = (_take_middle(of, one.grid) for of in pairs.get(one.order, pairs["right"]))
            arranged, at = arrange_views(part, one.view, one.order)
            made = corrupt_views(arranged, one, np.random.default_rng(number))
            yield Case(
                input=name,
                kind=LIGHT_FIELD,
                factors=one.describe(),
                views=made.views.astype(np.uint8),
                at=at,
                truth=true[one.view],
                border=SCALE,
                source=made,
                options=Options(views=f"{at[0]},{at[1]}", scale=SCALE),
            )


def crop_views(views: Views, kind: str) -> Views:
    """Returns the middle of each view, from which a low-resolution view of at most `SIDE` pixels a side is made."""
    cell = downscale.cell_size(kind, SCALE)
    sides = [min(length // cell, SIDE) * cell for length in views.shape[2:4]]
    top, left = ((length - side) // 2 for length, side in zip(views.shape[2:4], sides, strict=True))
    return views[:, :, top : top + sides[0], left : left + sides[1]]


def _take_middle(views: Views, grid: tuple[int, int]) -> Views:
    top, left = ((count - wanted) // 2 for count, wanted in zip(views.shape[:2], grid, strict=True))
    return views[top : top + grid[0], left : left + grid[1]]


def arrange_views(views: Views, view: View, order: Order) -> tuple[Views, View]:
    """Returns the views in `order`, and the position of `view` among them."""
    if order == "exchanged":
        v, u = (count // 2 for count in views.shape[:2])
        views = views.copy()
        views[v, [u - 1, u + 1]] = views[v, [u + 1, u - 1]]
    if order == "reversed":
        return views[::-1], (len(views) - 1 - view[0], view[1])
    return (views.swapaxes(0, 1), (view[1], view[0])) if order == "transposed" else (views, view)


def move_views(views: Views, random: np.random.Generator) -> Views:
    """Returns the views, each moved by -1, 0 or 1 pixels along both axes. Beyond its edge a view is repeated."""
    moved = np.empty_like(views)
    for view in np.ndindex(views.shape[:2]):
        moved[view] = np.roll(views[view], random.integers(-1, 2, 2), (0, 1))
    return moved


def roll_views(views: Views, random: np.random.Generator) -> Views:
    """Returns the views, each turned about its middle by up to `ROLL` degrees. Beyond its edge a view is mirrored."""
    rolled = np.empty_like(views)
    height, width = views.shape[2:4]
    margin = math.ceil(math.radians(ROLL) * max(height, width)) + 2
    for view in np.ndindex(views.shape[:2]):
        padded = np.pad(views[view], ((margin, margin), (margin, margin), (0, 0)), mode="symmetric")
        turned = Image.fromarray(padded).rotate(random.uniform(-ROLL, ROLL), Image.Resampling.BICUBIC)
        rolled[view] = np.asarray(turned)[margin:-margin, margin:-margin]
    return rolled


def corrupt_views(views: Views, variation: Variation, random: np.random.Generator) -> LightField:
    """Returns the views with the noise of `variation`, independent in each, and then compressed by its JPEG."""
    if variation.noise:
        noise = variation.noise * random.standard_normal(views.shape, np.float32)
        views = np.clip(np.rint(views + noise), 0, 255).astype(np.uint8)
    if variation.jpeg and variation.is_interleaved:
        return compress_array(views, variation.jpeg)
    if variation.jpeg:
        flat = np.ascontiguousarray(views).reshape(-1, *views.shape[2:])
        views = np.stack([compress_jpeg(view, variation.jpeg) for view in flat]).reshape(views.shape)
    return LightField(np.ascontiguousarray(views))


def read_light_field(name: str, source: Source, array: Options) -> Views:
    """Reads all views of a light field as 8-bit RGB. `array`: how to read an elemental image array.

    Raises the input errors of `ciir.errors`, and `InvalidOption` if views are smaller than `LEAST`.
    """
    pictures, report = reconstruct_views(source, replace(array, views="all", model="none", scale=1))
    counts = report["lens_array"]["pixels_v"], report["lens_array"]["pixels_u"]
    if min(pictures.shape[1:3]) < LEAST:
        size = f"{pictures.shape[1]}x{pictures.shape[2]}"
        raise InvalidOption(f"{name}: views of {size} pixels; give views of {LEAST}x{LEAST} or more")
    return pictures.reshape(*counts, *pictures.shape[1:])


def draw_light_field(*, quick: bool) -> Views:
    """Renders a globe in front of grey, as 9x9 views of 128x128 pixels; with `quick`, 5x5 of 64x64."""
    count, side = (5, 64) if quick else (9, 128)
    options = Options(
        lenses=(side, side),
        pixels=(count, count),
        sampling="lenslet",
        background=(80, 80, 80),
        delta=0.4 / 15,  # between views, as under lenses of 15x15 pixels
    )
    return read_light_field(DRAWN, "globe", options)
