"""Runs a light-field network over whole views, in tiles and batches, and collects the results in one output."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models.light_field.batches import Part, make_batches
from ciir.models.light_field.disparities.ranges import measure_ranges
from ciir.models.light_field.disparities.shifts import (
    crop_luma,
    find_margin,
    list_neighbours,
    list_shifts,
    make_no_shifts,
    measure_shifts,
    select_shifted,
    shift_part,
)
from ciir.models.light_field.pixels import convert_to_planes, round_levels, write_planes
from ciir.models.light_field.planes import Range
from ciir.models.light_field.skipping import (
    TileDifferences,
    count_skipped,
    find_background,
    make_pattern,
    split_by_mask,
)
from ciir.models.light_field.windows import WINDOW_SIDE, list_required_views, list_window
from ciir.models.parallel import is_parallel_faster, run_each
from ciir.models.sessions import TILE_PIXELS
from ciir.models.single.skipping import fill_with_pattern
from ciir.models.tiles import split_picture

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.models.light_field.batches import Batch
    from ciir.models.light_field.disparities.shifts import Pixels, Plane
    from ciir.models.light_field.network import LightFieldNetwork
    from ciir.models.light_field.windows import View
    from ciir.models.single.skipping import SkipStatistics
    from ciir.models.tiles import Tile


class Job(NamedTuple):
    """The arguments of `views.upscale_views` that all its steps share."""

    network: LightFieldNetwork
    views: Mapping[View, Pixels]
    grid: tuple[int, int]
    skip: bool
    statistics: SkipStatistics
    disparities: Range | None


class Output(NamedTuple):
    """The arrays that runs of the network fill, indexed by the numbers of views."""

    pictures: NDArray[np.uint16]
    """`(n, scale*H, scale*W, C)`. 8-bit views have 257 times their levels and are rounded when they are finished."""
    uncertainty: NDArray[np.float32]
    """`(n, H, W, 1)`."""
    shifts: Sequence[NDArray[np.int64]]
    """`(R, C)` each, from `measure_shifts`. They determine which run fills which part."""
    ranges: Sequence[Range]
    """The ranges of the disparities that remain after the shifts."""
    misalignments: Sequence[float]
    """How far the views' direct neighbours are from where they should be, LR pixels (`ranges.Tiles`)."""

    def find_range(self, number: int) -> Range:
        """Finds the range of a view's disparities, including its shifts."""
        shifts, left = self.shifts[number], self.ranges[number]
        return Range(int(shifts.min()) + left.lowest, int(shifts.max()) + left.highest)


def run_network(job: Job, wanted: Sequence[View]) -> Output:
    """Upscales the views `wanted`."""
    scale, first = job.network.scale, job.views[wanted[0]]
    height, width, channels = first.shape
    output = Output(
        np.empty((len(wanted), height * scale, width * scale, channels), np.uint16),
        np.empty((len(wanted), height, width, 1), np.float32),
        *_measure_disparities(job, wanted),
    )
    backgrounds = {number: _fill_background(job, view, output, number) for number, view in enumerate(wanted)}
    for tile in split_picture(height, width, radius=job.network.radius, tile_pixels=TILE_PIXELS):
        _run_tile(job, wanted, backgrounds, tile, output)
    return output


def _measure_disparities(job: Job, wanted: Sequence[View]) -> tuple[list[NDArray[np.int64]], list[Range], list[float]]:
    """Measures the shifts of each view's tiles, the range of the disparities that remain after them, and its
    misalignment.
    """
    if job.disparities is not None:
        height, width, _ = job.views[wanted[0]].shape
        count = len(wanted)
        return [make_no_shifts(height, width) for _ in wanted], [job.disparities] * count, [0.0] * count
    beside = (other for view in wanted for (other,) in list_neighbours([view], job.grid).values())
    lumas = {view: crop_luma(job.views[view]) for view in {*wanted, *beside}}
    shifts = measure_shifts(lumas, wanted, job.grid)
    return shifts, *measure_ranges(lumas, wanted, job.grid, shifts)


def _fill_background(job: Job, view: View, output: Output, number: int) -> Pixels | None:
    """Fills the output of `view` with the result for its background colour and returns that colour; None if there is
    no background to skip.
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


def _run_tile(
    job: Job, wanted: Sequence[View], backgrounds: Mapping[int, Pixels | None], tile: Tile, output: Output
) -> None:
    """Upscales what `tile` keeps of the views `wanted`, except for their `backgrounds`, into `output`."""
    network, views, grid = job[:3]
    masks: dict[int, dict[int, NDArray[np.bool_]]] = {}  # by shift, then by the view's number
    for number, shifts in enumerate(output.shifts):
        for shift in list_shifts(shifts, tile.kept):
            masks.setdefault(shift, {})[number] = select_shifted(shifts, shift, tile.kept)
    margin = max(map(find_margin, masks))
    differences = TileDifferences(views, grid, tile, margin)
    parts: dict[int, list[Part]] = {shift: [] for shift in masks}
    for shift, here in masks.items():
        for number, mask in here.items():
            colour = backgrounds[number]
            boxes = [tile] if colour is None else differences.find_boxes(wanted[number], colour, network.radius, shift)
            some = [Part(number, *part) for part in split_by_mask(network, boxes, mask, tile)]
            if colour is not None:
                job.statistics.uniform += count_skipped([part.tile for part in some], mask)
            parts[shift] += some
    if not any(parts.values()):
        return
    lumas = {view: crop_luma(views[view], tile.region, margin) for view in list_required_views(wanted, grid)}
    for shift, some in parts.items():
        batches = list(make_batches(some, wanted, grid, output.ranges))
        is_parallel = is_parallel_faster(len(batches), network.threads)
        cores = 1 if is_parallel else network.threads
        runner = _TileRunner(job, wanted, tile, lumas, margin, shift, output, cores)
        run_each(runner.run_batch, batches, network.threads if is_parallel else 1)


class _TileRunner(NamedTuple):
    """Runs the network on parts of one tile. Thread-safe, because the results of two parts of a view are equal to the
    bit where they overlap.
    """

    job: Job
    wanted: Sequence[View]
    tile: Tile
    lumas: Mapping[View, Plane]
    """Luma of the tile of each view, with `margin`."""
    margin: int
    shift: int
    output: Output
    cores: int

    def run_batch(self, batch: Batch) -> None:
        """Upscales the parts of a batch."""
        network, views, _ = self.job[:3]
        rows, cols, disparities, parts = batch
        image = np.stack([convert_to_planes(views[self.wanted[part.number]][part.tile.region]) for part in parts])
        around = np.empty((len(parts), WINDOW_SIDE * WINDOW_SIDE, *image.shape[2:]), np.float32)
        for part, window in zip(parts, around, strict=True):
            self._fill_window(window, part.tile, self.wanted[part.number])
        results = network(image, around, rows, cols, disparities, cores=self.cores)
        for (number, tile, mask), large, uncertain in zip(parts, *results, strict=True):
            kept = round_levels(large[:, *tile.kept_in_tile(network.scale)], self.output.pictures)
            write_planes(self.output.pictures[number][tile.kept_in_picture(network.scale)], kept, mask)
            write_planes(self.output.uncertainty[number][tile.kept], uncertain[:, *tile.kept_in_tile(1)], mask)

    def _fill_window(self, luma: NDArray[np.float32], part: Tile, view: View) -> None:
        """Sets `luma` `(25, h, w)` to the luma of a part of the window around `view`."""
        region = part.region_in(self.tile.region)
        for plane, (other, offset) in zip(luma, list_window(view, self.job.grid), strict=True):
            plane[...] = shift_part(self.lumas[other], self.shift, offset, self.margin)[region]
