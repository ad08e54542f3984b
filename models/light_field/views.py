"""Upscaling of views of a light field, each with the help of those around it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from ciir.bit_depth import count_unused_bits, lower_levels, raise_levels
from ciir.errors import InvalidImage
from ciir.models.light_field.batches import Part, make_batches
from ciir.models.light_field.disparities.ranges import measure_ranges
from ciir.models.light_field.disparities.shifts import (
    crop_luma,
    list_neighbours,
    make_no_shifts,
    measure_shifts,
    select_shifted,
    shift_part,
)
from ciir.models.light_field.finishing import Finishing, finish_view
from ciir.models.light_field.pixels import convert_to_planes, round_levels, write_planes
from ciir.models.light_field.sampling import find_sampling
from ciir.models.light_field.skipping import (
    TileDifferences,
    count_skipped,
    find_background,
    find_repeats,
    make_pattern,
    split_by_mask,
)
from ciir.models.light_field.windows import WINDOW_SIDE, list_window
from ciir.models.parallel import is_parallel_faster, run_each
from ciir.models.sessions import TILE_PIXELS
from ciir.models.single.pixels import upscale_pixels
from ciir.models.single.skipping import SkipStatistics, fill_with_pattern
from ciir.models.tiles import split_picture

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.models.light_field.batches import Batch
    from ciir.models.light_field.disparities.shifts import Pixels, Plane
    from ciir.models.light_field.network import LightFieldNetwork
    from ciir.models.light_field.planes import Range
    from ciir.models.light_field.windows import View
    from ciir.models.tiles import Tile
    from ciir.models.upscaler import Upscaler


def list_required_views(wanted: Sequence[View], grid: tuple[int, int]) -> list[View]:
    """Every view (v, u) of the windows around `wanted`, in a grid of `grid` views, row by row and each once."""
    return sorted({other for view in wanted for other, _ in list_window(view, grid)})


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
    `list_required_views`. `fallback`: a single-image model of the same scale. `skip`: whether to skip uniform and
    repeated parts (`models.light_field.skipping`), which doesn't change the result. `statistics`: the pixels are added
    to it. `finds_sampling`: whether to find how views were sampled, and to finish them accordingly. `disparities`: the
    range of all content, pixels from one view to the next, at most `ranges.FARTHEST` to either side; None: it is
    measured.

    Returns `(len(wanted), scale*H, scale*W, C)` of the same type, rounded to nearest, grey as the mean of three
    channels; and how each was finished.

    The fallback is used where the network has low confidence, because the views around don't match: another scene,
    noise, or disparities out of range (`models.light_field.finishing`). Where content moves by more than a pixel from
    one view to the next, the views around are first shifted back by whole pixels: the network runs once for each shift,
    on boxes around the parts that have it. Its planes are spread over the range of the disparities that are left in a
    view (`models.light_field.disparities`). The result for a view doesn't depend on which others are wanted. Large
    views are upscaled in tiles, all views of one tile after another, to save memory. Levels of 16 bit that use fewer
    are multiplied by a power of two before, and divided after (`ciir.bit_depth`).

    Raises `InvalidImage` where the views differ in shape or type, or have alpha or another number of channels.
    """
    required = list_required_views(wanted, grid)
    _check_views(views, wanted[0], required)
    statistics = SkipStatistics() if statistics is None else statistics
    bits = {view: count_unused_bits(views[view]) for view in required}
    by_bits: dict[int, list[int]] = {}
    for number, view in enumerate(wanted):
        by_bits.setdefault(min(bits[other] for other, _ in list_window(view, grid)), []).append(number)
    made = []
    for unused, numbers in by_bits.items():
        some = [wanted[number] for number in numbers]
        raised = {view: raise_levels(views[view], unused) for view in list_required_views(some, grid)}
        job = _Job(network, raised, grid, skip, statistics, disparities)
        pictures, finished = _upscale_repeated(job, fallback, some, finds_sampling)
        made.append((lower_levels(pictures, unused), finished))
    return join_groups(list(by_bits.values()), made)


def join_groups(
    groups: Sequence[Sequence[int]], made: Sequence[tuple[Pixels, list[Finishing]]]
) -> tuple[Pixels, list[Finishing]]:
    """The results of `upscale_views` for views in `groups` of their numbers, in the order of the numbers."""
    if len(groups) == 1:
        return made[0]
    order = np.argsort(np.concatenate(groups))
    finished = [each for _, some in made for each in some]
    return np.concatenate([pictures for pictures, _ in made])[order], [finished[place] for place in order]


class _Job(NamedTuple):
    """The arguments of `upscale_views` that all its steps share."""

    network: LightFieldNetwork
    views: Mapping[View, Pixels]
    grid: tuple[int, int]
    skip: bool
    statistics: SkipStatistics
    disparities: Range | None


class _Output(NamedTuple):
    """The arrays that runs of the network fill, by the numbers of views."""

    pictures: Pixels
    """`(n, scale*H, scale*W, C)`."""
    uncertainty: NDArray[np.float32]
    """`(n, H, W, 1)`."""
    shifts: Sequence[NDArray[np.int64]]
    """`(R, C)` each, from `measure_shifts`: which run fills which part."""
    ranges: Sequence[Range]
    """Of the disparities that shifts leave."""


def _upscale_repeated(
    job: _Job, fallback: Upscaler, wanted: Sequence[View], finds_sampling: bool
) -> tuple[Pixels, list[Finishing]]:
    """The views `wanted`, each of several with equal windows upscaled once, and how each was finished."""
    pixels = job.views[wanted[0]].shape[0] * job.views[wanted[0]].shape[1]
    job.statistics.pixels += len(wanted) * pixels
    firsts = list(range(len(wanted)))
    if job.skip and len(wanted) > 1:
        firsts = find_repeats(job.views, wanted, job.grid)
    distinct = sorted(set(firsts))
    job.statistics.repeated += (len(wanted) - len(distinct)) * pixels
    result, made = _upscale_distinct(job, fallback, [wanted[number] for number in distinct], finds_sampling)
    places = np.searchsorted(distinct, firsts)
    return result if len(distinct) == len(wanted) else result[places], [made[place] for place in places]


def _upscale_distinct(
    job: _Job, fallback: Upscaler, wanted: Sequence[View], finds_sampling: bool
) -> tuple[Pixels, list[Finishing]]:
    """The views `wanted`, and how each was finished."""
    scale, first = job.network.scale, job.views[wanted[0]]
    height, width, channels = first.shape
    output = _Output(
        np.empty((len(wanted), height * scale, width * scale, channels), first.dtype),
        np.empty((len(wanted), height, width, 1), np.float32),
        *_measure_disparities(job, wanted),
    )
    by_shift: dict[int, dict[int, View]] = {}
    for number, view in enumerate(wanted):
        for shift in set(output.shifts[number].ravel().tolist()):
            by_shift.setdefault(shift, {})[number] = view
    backgrounds = {number: _fill_background(job, view, output, number) for number, view in enumerate(wanted)}
    for shift, group in by_shift.items():
        _run_network(job, group, backgrounds, shift, output)
    made = []
    for number, view in enumerate(wanted):
        picture, small, uncertainty = output.pictures[number], job.views[view], output.uncertainty[number, ..., 0]
        sampling = find_sampling(picture, small) if finds_sampling else None
        sides = [min(at, length - 1 - at) for at, length in zip(view, job.grid, strict=True)]
        alone = partial(_upscale_single, fallback, small, job.skip)
        surrounded = min(sides) >= WINDOW_SIDE // 2
        made.append(finish_view(picture, small, uncertainty, sampling, alone, is_surrounded=surrounded))
    return output.pictures, made


def _measure_disparities(job: _Job, wanted: Sequence[View]) -> tuple[list[NDArray[np.int64]], list[Range]]:
    """The shifts of each view's tiles, and the range of the disparities that they leave."""
    if job.disparities is not None:
        height, width, _ = job.views[wanted[0]].shape
        return [make_no_shifts(height, width) for _ in wanted], [job.disparities] * len(wanted)
    beside = (other for view in wanted for (other,) in list_neighbours([view], job.grid).values())
    lumas = {view: crop_luma(job.views[view]) for view in {*wanted, *beside}}
    shifts = measure_shifts(lumas, wanted, job.grid)
    return shifts, measure_ranges(lumas, wanted, job.grid, shifts)


def _fill_background(job: _Job, view: View, output: _Output, number: int) -> Pixels | None:
    """Fills the output of `view` with the result for its background colour, and returns the colour; None where there
    is no background to skip.
    """
    network = job.network
    background = find_background(network, job.views[view]) if job.skip else None
    if background is not None:
        large, uncertainty = make_pattern(network, background, view, job.grid, output.ranges[number])
        picture = output.pictures[number]
        levels = round_levels(large.transpose(2, 0, 1), picture).transpose(1, 2, 0)
        fill_with_pattern(picture, levels, network.radius, network.scale)
        fill_with_pattern(output.uncertainty[number], uncertainty, network.radius, 1)
    return background


def _run_network(
    job: _Job,
    group: Mapping[int, View],
    backgrounds: Mapping[int, Pixels | None],
    shift: int,
    output: _Output,
) -> None:
    """Upscales the parts of the views of `group` that have `shift` into `output`, except for their `backgrounds`, all
    by their numbers. The views around are shifted by `shift`.
    """
    network, views, grid = job[:3]
    height, width = views[next(iter(group.values()))].shape[:2]
    for tile in split_picture(height, width, radius=network.radius, tile_pixels=TILE_PIXELS):
        masks = {number: select_shifted(output.shifts[number], shift, tile.kept) for number in group}
        here = {number: view for number, view in group.items() if masks[number].any()}
        required = list_required_views(list(here.values()), grid)
        lumas = {view: crop_luma(views[view], tile.region, shift) for view in required}
        differences = TileDifferences(views, grid, tile, shift)
        parts: list[Part] = []
        for number, view in here.items():
            colour = backgrounds[number]
            boxes = [tile] if colour is None else differences.find_boxes(view, colour, network.radius)
            some = [Part(number, *part) for part in split_by_mask(network, boxes, masks[number], tile)]
            if colour is not None:
                job.statistics.uniform += count_skipped([part.tile for part in some], masks[number])
            parts += some
        batches = list(make_batches(parts, group, grid, output.ranges))
        is_parallel = is_parallel_faster(len(batches), network.threads)
        runner = _TileRunner(job, group, tile, lumas, shift, output, cores=1 if is_parallel else network.threads)
        run_each(runner.run_batch, batches, network.threads if is_parallel else 1)


class _TileRunner(NamedTuple):
    """Runs the network on parts of one tile. Thread-safe: where two parts of a view overlap, their results are equal to
    the bit.
    """

    job: _Job
    group: Mapping[int, View]
    tile: Tile
    lumas: Mapping[View, Plane]
    shift: int
    output: _Output
    cores: int

    def run_batch(self, batch: Batch) -> None:
        """Upscales the parts of a batch, of views by their numbers."""
        network, views, _ = self.job[:3]
        rows, cols, disparities, parts = batch
        image = np.stack([convert_to_planes(views[self.group[part.number]][part.tile.region]) for part in parts])
        around = np.empty((len(parts), WINDOW_SIDE * WINDOW_SIDE, *image.shape[2:]), np.float32)
        for part, window in zip(parts, around, strict=True):
            self._fill_window(window, part.tile, self.group[part.number])
        results = network(image, around, rows, cols, disparities, cores=self.cores)
        for (number, tile, mask), large, uncertain in zip(parts, *results, strict=True):
            kept = round_levels(large[:, *tile.kept_in_tile(network.scale)], self.output.pictures)
            write_planes(self.output.pictures[number][tile.kept_in_picture(network.scale)], kept, mask)
            write_planes(self.output.uncertainty[number][tile.kept], uncertain[:, *tile.kept_in_tile(1)], mask)

    def _fill_window(self, luma: NDArray[np.float32], part: Tile, view: View) -> None:
        """Sets `luma` `(25, h, w)` to that of a part of the window around `view`."""
        region = part.region_in(self.tile.region)
        for plane, (other, offset) in zip(luma, list_window(view, self.job.grid), strict=True):
            plane[...] = shift_part(self.lumas[other], self.shift, offset)[region]


def _upscale_single(upscaler: Upscaler, view: Pixels, skip: bool) -> Pixels:
    # The type variable of `upscale_pixels` is 8 or 16 bit, where a view may be either: one stands for both.
    large: Pixels = upscale_pixels(upscaler, cast("NDArray[np.uint8]", view[np.newaxis]), skip=skip)[0]
    return large


def _check_views(views: Mapping[View, Pixels], view: View, required: Sequence[View]) -> None:
    """Raises `InvalidImage` where `view` is no picture, or one of the `required` views is not like it."""
    first = views[view]
    if first.ndim != 3 or first.shape[2] not in (1, 3) or first.dtype not in (np.uint8, np.uint16):
        raise InvalidImage(
            f"views of shape {first.shape} and {first.dtype}: give (H, W, C), grey or RGB, of 8 or 16 bit"
        )
    for v, u in required:
        other = views[v, u]
        if other.shape != first.shape or other.dtype != first.dtype:
            raise InvalidImage(
                f"view {v},{u}: {other.shape} of {other.dtype}, where view {view[0]},{view[1]} is {first.shape} of "
                f"{first.dtype}; give views of one size and depth"
            )
