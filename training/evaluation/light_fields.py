"""Accuracy on light fields, as BasicLFSR (Liang et al., github.com/ZhengyuLiang24/BasicLFSR) measures it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from tqdm import tqdm

from ciir.bit_depth import round_to_depth
from ciir.errors import UnknownModel, UnsupportedScale
from ciir.models import cards, catalogue
from ciir.models.light_field.finishing import Finishing
from ciir.models.light_field.fusion.views import FusingUpscaler, explain_no_fusion, is_matched
from ciir.models.light_field.network import LightFieldNetwork
from ciir.models.light_field.runner import Job, run_network
from ciir.models.light_field.strides import choose_stride
from ciir.models.light_field.views import upscale_views
from ciir.models.light_field.windows import MINIMUM_GRID
from ciir.models.single.network import SingleImageNetwork
from ciir.models.single.pixels import upscale_pixels
from ciir.models.single.skipping import SkipStatistics
from ciir.renderer.light_field import LightField
from ciir.renderer.view_order.motion import measure_motion
from ciir.training.data.downscale import POINT
from ciir.training.data.light_field.views import compress_array, convert_views, degrade_views, read_light_field
from ciir.training.evaluation.metrics import average, compute_psnr, compute_ssim, convert_to_luma

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ciir.models.cards import Accuracy
    from ciir.models.light_field.disparities.shifts import Pixels
    from ciir.models.light_field.fusion import Fusion
    from ciir.models.upscaler import Upscaler
    from ciir.renderer.readers.layout import Layout
    from ciir.renderer.views import View

GRID = (5, 5)
"""The number of views down and across in BasicLFSR's tables."""
PROTOCOL = (
    "Mean over the views of the central 5x5 of PSNR (dB) and SSIM of Y (ITU-R BT.601, studio range, not rounded, of "
    "8-bit RGB; grey views are their own Y) after the output is rounded to 8 bits and a border of `scale` pixels is "
    "cut; each view is upscaled with those 5x5 alone. LR: each view made small as `data` names it, to 8 bits; bicubic "
    "as by MATLAB's imresize, which is BasicLFSR's protocol but for the rounding and the border; with point "
    f"{POINT}. SSIM: Wang et al. 2004, 11x11 Gaussian window of sigma 1.5, valid region, K 0.01 and 0.03, L 255. "
    "The mean PSNR is that of views that aren't identical, if there are any."
)


class Measured(NamedTuple):
    """Scores of a model on a light field."""

    mean: Accuracy
    views: dict[View, tuple[float, float]]
    """(v, u) in the grid -> Y-PSNR (dB, infinite if nothing differs) and SSIM."""
    notes: tuple[str, ...] = ()
    """What was found while the light field was read."""
    averaged: int = 0
    """The number of views that are means of a light-field network's picture and the fallback's, because they look
    filtered (`models.light_field.finishing`)."""


def describe_protocol(grid: tuple[int, int] = GRID) -> str:
    """Returns `PROTOCOL` for the middle `grid` = (V, U) views."""
    return PROTOCOL.replace("5x5", f"{grid[0]}x{grid[1]}")


def measure(
    network: Upscaler | LightFieldNetwork,
    path: Path,
    *,
    grid: tuple[int, int] = GRID,
    degradation: str = "bicubic",
    layout: Layout | None = None,
    jpeg: int | None = None,
    fusion: Fusion = "auto",
    network_only: bool = False,
) -> Measured:
    """Measures Y-PSNR (dB) and SSIM of the middle `grid` = (V, U) views of a light field, and their means.

    `path` and `layout` are as for `training.data.light_field.views.read_light_field`. Each view is degraded by
    `training.data.downscale.downscale_picture` and upscaled with only the views of the grid, as by `ciir reconstruct`:
    with a single-picture fallback, in float, and corrected for the sampling that is found. A single-picture model
    upscales view by view. Unlike in BasicLFSR, LR and output are 8-bit RGB or grey, and a border of `scale` pixels is
    cut.

    `jpeg`: if given, the low-resolution views are those of an elemental image array in a JPEG of this quality
    (`training.data.light_field.views.compress_array`). `fusion`: which views a light-field network's are fused with
    those around them (`models.light_field.fusion.views`). `network_only`: whether a light-field network is scored
    without anything that follows it, as by `upscale_by_network`.

    Raises `ValueError` if there is no full grid of views of one size, it is smaller than `grid`, or the views are
    too small to be scored or too few for a light-field network.
    """
    if isinstance(network, LightFieldNetwork) and min(grid) < MINIMUM_GRID:
        raise ValueError(
            f"--grid {grid[0]}x{grid[1]}: {network.name} takes {MINIMUM_GRID}x{MINIMUM_GRID} views or more; give "
            "those, or another model"
        )
    field = read_light_field(path, grid=grid, layout=layout)
    low, high = degrade_views(convert_views(field.views, keeps_grey=True), degradation, network.scale)
    array = LightField(low) if jpeg is None else compress_array(low, jpeg)
    views = [(v, u) for v in range(grid[0]) for u in range(grid[1])]
    given = {view: array.views[view] for view in views}
    stride = choose_stride(measure_motion(array.views), grid)
    scores: dict[View, tuple[float, float]] = {}
    if fusion == "auto" and explain_no_fusion(low[0, 0, ..., 0].size, stride):
        fusion = "never"
    finished: list[Finishing] = []
    if isinstance(network, LightFieldNetwork):
        fallback = catalogue.load_upscaler(catalogue.FALLBACK, scale=network.scale)
        make = FusingUpscaler(
            partial(upscale_by_network, network)
            if network_only
            else partial(upscale_views, network, fallback, finds_sampling=True),
            grid,
            stride,
            fusion="never" if network_only else fusion,
            matches=is_matched(fusion, network.card.macs_per_output_pixel),
            is_jpeg=array.is_jpeg,
            fetch=lambda absent: {view: given[view] for view in absent},
            cores=1,
        )
    for view in tqdm(views, desc=path.name, disable=None, unit="view", leave=False):
        if isinstance(network, LightFieldNetwork):
            made, how = make(given, [view])
            finished += how
        else:
            made = upscale_pixels(network, array.views[view][np.newaxis])
        got, truth = convert_to_luma(made[0].astype(np.uint8)), convert_to_luma(high[view])
        try:
            ssim = compute_ssim(got, truth, border=network.scale)
        except ValueError as error:
            raise ValueError(f"{path}: {error}; name larger views") from error
        scores[view] = (float(compute_psnr(got, truth, border=network.scale)), float(ssim))
    kind = degradation if jpeg is None else f"{degradation}, JPEG {jpeg}"
    name = f"{path.resolve().name} {grid[0]}x{grid[1]} ({kind})"
    mean = average(name, scores)
    if finished:
        mean = replace(mean, fallback=round(sum(each.fallback for each in finished) / len(finished), 4))
    return Measured(mean, scores, field.notes, sum(each.is_averaged for each in finished))


def upscale_by_network(
    network: LightFieldNetwork, views: Mapping[View, Pixels], wanted: Sequence[View], grid: tuple[int, int]
) -> tuple[Pixels, list[Finishing]]:
    """Upscales 8-bit views as `models.light_field.views.upscale_views` does, but only by the network: without the
    fallback, and without the corrections for how views were sampled.
    """
    output = run_network(Job(network, views, grid, True, SkipStatistics(), None), wanted)
    finished = [Finishing(disparities=output.find_range(number)) for number in range(len(wanted))]
    return round_to_depth(output.pictures, views[wanted[0]].dtype), finished


def load_network(model: str, scale: int) -> Upscaler | LightFieldNetwork:
    """Loads a model by its name in the catalogue, or an exported network by the path of its card.

    `auto` is the default for light fields. int8 is emulated if the processor doesn't support it.

    Raises `ciir.errors.ModelError` if there is no such model, or it doesn't upscale by `scale`.
    """
    model = catalogue.light_field_default_name() if model == "auto" else model
    if model.endswith(".json"):
        path = Path(model)
        card = cards.read_card(path)
        if card.scale != scale:
            raise UnsupportedScale(f"scale: {card.name} upscales by {card.scale}, not {scale}; give that")
        kind = LightFieldNetwork if card.is_light_field else SingleImageNetwork
        return kind(path, emulates_int8=True)
    if model not in catalogue.list_names():
        raise UnknownModel(f"model: no {model!r} here; give one of {', '.join(catalogue.list_names())}")
    if model not in catalogue.list_single_image_names():
        return catalogue.load_light_field_network(model, scale=scale, emulates_int8=True)
    return catalogue.load_upscaler(model, scale=scale, emulates_int8=True)
