"""Upscales views of a light field, each with the help of its neighbouring views."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from ciir.bit_depth import count_raised_bits, lower_levels, raise_levels, round_to_depth
from ciir.errors import InvalidImage
from ciir.models.light_field.finishing import Finishing, finish_view
from ciir.models.light_field.runner import Job, run_network
from ciir.models.light_field.windows import WINDOW_SIDE, find_middle, list_required_views, list_window
from ciir.models.sampling import Sampling, find_sampling
from ciir.models.single.finishing import average_misfit
from ciir.models.single.pixels import upscale_pixels
from ciir.models.single.skipping import SkipStatistics

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.models.light_field.disparities.shifts import Pixels
    from ciir.models.light_field.network import LightFieldNetwork
    from ciir.models.light_field.planes import Range
    from ciir.models.light_field.windows import View
    from ciir.models.upscaler import Upscaler


def upscale_views(
    network: LightFieldNetwork,
    fallback: Upscaler,
    views: Mapping[View, Pixels],
    wanted: Sequence[View],
    grid: tuple[int, int],
    *,
    skip: bool = True,
    statistics: SkipStatistics | None = None,
    finds_sampling: bool = False,
    disparities: Range | None = None,
) -> tuple[Pixels, list[Finishing]]:
    """Upscales the views `wanted` of a light field of `grid` = (V, U) views, each with the help of its window.

    `views`: (v, u) -> `(H, W, C)`, grey or RGB, 8 or 16 bit, all of one shape and type; at least those of
    `list_required_views`. `fallback`: a single-picture model of the same scale. `skip`: whether to skip uniform
    parts (`models.light_field.skipping`), which doesn't change the result. `statistics`: the counts that the
    pixels are added to. `finds_sampling`: whether to find how views were sampled, and whether they are misaligned, and
    finish them accordingly; and to average what the fallback makes badly with interpolation, as captured views that are
    upscaled by themselves.
    `disparities`: the range of all content, pixels from one view to the next, at most `ranges.FARTHEST` in either
    direction; None to measure it.

    Returns `(len(wanted), scale*H, scale*W, C)` of the same type, rounded to nearest, with grey as the mean of three
    channels, and how each view was finished.

    The fallback is used where the network has low confidence because the neighbouring views don't match: they show
    another scene or noise, or disparities are out of range (`models.light_field.finishing`). Where content moves by
    more than a pixel from one view to the next, the neighbouring views are first shifted back by whole pixels. The
    network runs once for each shift, on boxes around the parts that have it. Its planes are spread over the range of
    the disparities that remain in a view (`models.light_field.disparities`). The result for a view doesn't depend on
    which others are wanted. Large views are upscaled in tiles, all views of one tile after another, to save memory.
    16-bit levels that use fewer bits, and dark 8-bit ones, are multiplied by a power of two beforehand and divided by
    it afterwards (`ciir.bit_depth`).

    Raises `InvalidImage` if the views differ in shape or type, or have alpha or another number of channels.
    """
    required = list_required_views(wanted, grid)
    _check_views(views, wanted[0], required)
    statistics = SkipStatistics() if statistics is None else statistics
    height, width = views[wanted[0]].shape[:2]
    statistics.pixels += len(wanted) * height * width
    count_bits = cache(lambda view: count_raised_bits(views[view]))
    by_bits: dict[int, list[int]] = {}
    for number, view in enumerate(wanted):
        unused = count_bits(view) and min(count_bits(other) for other, _ in list_window(view, grid))
        by_bits.setdefault(unused, []).append(number)
    made = []
    for unused, numbers in by_bits.items():
        some = [wanted[number] for number in numbers]
        raised = {view: raise_levels(views[view], unused) for view in list_required_views(some, grid)}
        job = Job(network, raised, grid, skip, statistics, disparities)
        pictures, finished = _upscale_group(job, fallback, some, finds_sampling)
        made.append((round_to_depth(lower_levels(pictures, unused), views[some[0]].dtype), finished))
    return join_groups(list(by_bits.values()), made)


def join_groups(
    groups: Sequence[Sequence[int]], made: Sequence[tuple[Pixels, list[Finishing]]]
) -> tuple[Pixels, list[Finishing]]:
    """Joins the results of `upscale_views` for `groups` of views, given by their numbers, in order of these numbers."""
    if len(groups) == 1:
        return made[0]
    order = np.argsort(np.concatenate(groups))
    finished = [each for _, some in made for each in some]
    return np.concatenate([pictures for pictures, _ in made])[order], [finished[place] for place in order]


def _upscale_group(
    job: Job, fallback: Upscaler, wanted: Sequence[View], finds_sampling: bool
) -> tuple[Pixels, list[Finishing]]:
    """Upscales the views `wanted`, and returns how each was finished too."""
    output = run_network(job, wanted)
    samplings = _find_samplings(job, wanted, output.pictures) if finds_sampling else [None] * len(wanted)
    made = []
    for number, view in enumerate(wanted):
        picture, small, uncertainty = output.pictures[number], job.views[view], output.uncertainty[number, ..., 0]
        alone = partial(_upscale_single, fallback, small, job.skip, averages_misfits=finds_sampling)
        surrounded = find_middle(view, job.grid) == view and min(job.grid) >= WINDOW_SIDE
        finishing = finish_view(
            picture,
            small,
            uncertainty,
            samplings[number],
            alone,
            is_surrounded=surrounded,
            runs=job.network.runs,
            disparities=output.find_range(number),
            misalignment=output.misalignments[number] if finds_sampling else 0.0,
        )
        made.append(finishing)
    return output.pictures, made


def _find_samplings(job: Job, wanted: Sequence[View], pictures: Pixels) -> list[Sampling | None]:
    """Finds how each view was sampled. If its own picture leaves that uncertain, the middle view of its window decides,
    because the network upscales it better than a view at the border of the grid.
    """
    found = [find_sampling(picture, job.views[view]) for picture, view in zip(pictures, wanted, strict=True)]
    middles = {number: find_middle(view, job.grid) for number, view in enumerate(wanted) if not found[number].is_sure}
    made = dict(zip(wanted, pictures, strict=True))
    missing = sorted(set(middles.values()) - made.keys())
    if missing:
        output = run_network(job._replace(statistics=SkipStatistics()), missing)
        made |= dict(zip(missing, output.pictures, strict=True))
    for number, middle in middles.items():
        found[number] = find_sampling(made[middle], job.views[middle])
    return [each.sampling for each in found]


def _upscale_single(
    upscaler: Upscaler, view: Pixels, skip: bool, *, averages_misfits: bool
) -> tuple[NDArray[np.uint16], float]:
    """Upscales a view by itself, and returns the share of interpolation in it too (`models.single.finishing`)."""
    large: NDArray[np.uint16] = upscale_pixels(upscaler, view[np.newaxis], skip=skip, keeps_fractions=True)[0]
    small = view if view.dtype == np.uint16 else view * np.uint16(257)
    return large, average_misfit(large, small) if averages_misfits else 0.0


def _check_views(views: Mapping[View, Pixels], view: View, required: Sequence[View]) -> None:
    """Raises `InvalidImage` if `view` is not a picture, or one of the `required` views has another shape or type."""
    first = views[view]
    if first.ndim != 3 or first.shape[2] not in (1, 3) or first.dtype not in (np.uint8, np.uint16):
        raise InvalidImage(
            f"views of shape {first.shape} and {first.dtype}: give (H, W, C), grey or RGB, of 8 or 16 bit"
        )
    for v, u in required:
        other = views[v, u]
        if other.shape != first.shape or other.dtype != first.dtype:
            raise InvalidImage(
                f"view {v},{u}: {other.shape} of {other.dtype}, but view {view[0]},{view[1]} is {first.shape} of "
                f"{first.dtype}; give views of one size and depth"
            )
