"""Upscales views, and fuses some of them with the upscaled views around them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from ciir.bit_depth import count_raised_bits, lower_levels, raise_levels
from ciir.models.back_projection import measure_contrast, restore_luma
from ciir.models.light_field.fusion.disparity import FINE_STEP, STEP, estimate_disparity
from ciir.models.light_field.fusion.matching import Seen, match_views
from ciir.models.light_field.fusion.pixels import fuse_lumas
from ciir.models.light_field.network import compute_luma
from ciir.models.light_field.planes import Range
from ciir.models.light_field.strides import list_spaced_views, upscale_spaced_views
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.models.parallel import run_each
from ciir.models.sampling import find_common_means

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.models.light_field.disparities.shifts import Pixels, Plane
    from ciir.models.light_field.finishing import Finishing
    from ciir.models.light_field.fusion import Fusion
    from ciir.models.light_field.strides import UpscaleViews
    from ciir.models.light_field.windows import View
    from ciir.models.sampling import Sampling

Value = TypeVar("Value")

BLOCK_SIDE = 3
"""Views along each side of the block whose mean a fused view is."""
CROSS_SIDE = 5
"""Views along each line of the cross that a view's disparity is measured with."""
AT_ONCE, AT_ONCE_PIXELS = 3, 130_000
"""Most views that are upscaled at once, to save memory: the first number, or as many as have so few pixels."""
JPEG_NOISE = 3.0
"""Factor on the differences from the input that count as noise, so that little of a JPEG's errors comes back."""
MATCHING_NOISE = 1 / 3
"""Factor on those differences if several views are matched: noise differs from view to view, content doesn't."""
LEVELS = 2**16 - 1
MATCHED_MACS = 150_000
"""Views that a network with at least so many multiply-adds for each output pixel makes are matched too: it takes longer
than matching."""
MOST_PIXELS = 100_000
"""Largest views, in pixels, that `auto` fuses. A single one of that size takes 1.5 seconds more on two cores."""


class _Upscaled(NamedTuple):
    """An upscaled view."""

    picture: Pixels
    finishing: Finishing


def is_matched(fusion: Fusion, macs_per_output_pixel: float) -> bool:
    """Whether views that are fused are also matched with the views around them (`fusion.matching`)."""
    return fusion == "always" or macs_per_output_pixel >= MATCHED_MACS


def explain_no_fusion(pixels: int, stride: int) -> str:
    """Says why `auto` fuses no views of `pixels` pixels whose windows have `stride`; empty if it may."""
    if pixels > MOST_PIXELS:
        return f"views of more than {MOST_PIXELS:,} pixels take long"
    return "content moves little from view to view, so neighbours have much the same errors" if stride > 1 else ""


def list_line(view: View, grid: tuple[int, int], axis: int, side: int = BLOCK_SIDE) -> list[View]:
    """Lists `side` views of the column (`axis` 0) or row (1) of `view`, which is in their middle, in a grid of `grid`
    views. At the border of the grid more of them lie on one side of it.
    """
    first = max(0, min(view[axis] - side // 2, grid[axis] - side))
    places = range(first, min(first + side, grid[axis]))
    return [(place, view[1]) if axis == 0 else (view[0], place) for place in places]


def list_cross(view: View, grid: tuple[int, int]) -> list[View]:
    """Lists the views that the disparity of `view` is measured with, and `view` itself."""
    return sorted({other for axis in (0, 1) for other in list_line(view, grid, axis, CROSS_SIDE)})


def list_nearest(view: View, grid: tuple[int, int]) -> list[View]:
    """Lists the views that `view` is matched with, the nearest four in its row and column, and `view` itself."""
    return sorted({other for axis in (0, 1) for other in list_line(view, grid, axis)})


def list_block(view: View, grid: tuple[int, int]) -> list[View]:
    """Lists the 3x3 views around `view`, and `view` itself, row by row; at the border as `list_line` does."""
    return [other for row in list_line(view, grid, 0) for other in list_line(row, grid, 1)]


def list_fused_views(wanted: Sequence[View], grid: tuple[int, int], stride: int) -> list[View]:
    """Lists every view that `FusingUpscaler` may need for `wanted`, row by row and each once."""
    blocks = sorted({other for view in wanted for other in list_block(view, grid)})
    return list_spaced_views(blocks, grid, stride)


class FusingUpscaler:
    """Upscales views of a grid, and replaces some of them by the means of their blocks' upscaled views.

    The mean of a block is taken in two steps: first of each of its rows, in the column of the wanted view, then of
    these means. Neighbouring blocks share rows. A view's result doesn't depend on which others are wanted. The latest
    views and means of rows are kept, so that each is made once if views are wanted row by row, or column by column.
    """

    def __init__(
        self,
        upscale: UpscaleViews,
        grid: tuple[int, int],
        stride: int,
        *,
        fusion: Fusion,
        matches: bool,
        is_jpeg: bool,
        fetch: Callable[[Sequence[View]], Mapping[View, Pixels]],
        cores: int,
    ) -> None:
        """`upscale`, `grid`, `stride`: as for `upscale_spaced_views`. `matches`: whether fused views are also matched
        with the views around them, as `is_matched` says. `is_jpeg`: whether the views are those of a JPEG array.
        `fetch`: returns views that a call didn't give. `cores`: most views that are fused at once.
        """
        self._upscale, self._grid, self._stride = upscale, grid, stride
        self._fusion, self._matches, self._is_jpeg = fusion, matches, is_jpeg
        self._fetch, self._cores = fetch, cores
        longest = max(grid)
        self._most_upscaled = BLOCK_SIDE * (longest + 2)
        self._most_views = (BLOCK_SIDE - 1 + WINDOW_SIDE * stride) * longest
        self._views: dict[View, Pixels] = {}
        self._upscaled: dict[View, _Upscaled] = {}
        self._samplings: dict[View, Sampling | None] = {}  # of all so far: means of rows outlive the views
        self._disparities: dict[View, Plane] = {}
        self._rows: dict[View, NDArray[np.uint16]] = {}  # the luma of means of a view and those beside it in its row

    def __call__(self, views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, list[Finishing]]:
        """Upscales the views `wanted`, as `models.light_field.views.upscale_views` does."""
        if self._fusion == "never":
            return upscale_spaced_views(self._upscale, views, wanted, self._grid, self._stride)
        _refresh(self._views, views)
        self._fetch_missing(wanted)
        self._upscale_views(wanted)
        finished = [self._upscaled[view].finishing for view in wanted]
        numbers = [number for number, finishing in enumerate(finished) if self._is_fused(finishing)]
        self._fuse_rows({other for number in numbers for other in list_line(wanted[number], self._grid, 0)})
        if self._matches:
            nearest = {other for number in numbers for other in list_nearest(wanted[number], self._grid)}
            self._fetch_missing(nearest)
            self._find_disparities(nearest)
        result: Any = np.stack([self._upscaled[view].picture for view in wanted])

        def fuse(number: int) -> None:
            sampling = self._find_sampling(wanted[number])
            cores = max(1, self._cores // len(numbers))
            matched = self._fuse(wanted[number], result[number], sampling, cores)
            finished[number] = finished[number]._replace(is_fused=True, is_matched=matched, sampling=sampling)

        self._run_each(fuse, numbers)
        _shorten(self._upscaled, self._most_upscaled)
        _shorten(self._rows, self._most_upscaled)
        _shorten(self._disparities, self._most_upscaled)
        _shorten(self._views, self._most_views)
        return result, finished

    def _is_fused(self, finishing: Finishing) -> bool:
        if finishing.is_misaligned:
            return False
        return self._fusion == "always" or self._is_jpeg or finishing.is_averaged

    def _run_each(self, work: Callable[[Value], object], items: Sequence[Value]) -> None:
        run_each(work, items, min(self._cores, max(1, len(items))))

    def _fetch_missing(self, views: Iterable[View]) -> None:
        """Fetches those of `views` that are not kept."""
        if missing := _refresh_kept(self._views, views):
            self._views.update(self._fetch(missing))

    def _upscale_views(self, wanted: Iterable[View]) -> None:
        """Upscales those of `wanted` that are not kept."""
        missing = _refresh_kept(self._upscaled, wanted)
        if not missing:
            return
        self._fetch_missing(list_spaced_views(missing, self._grid, self._stride))
        height, width, _ = self._views[missing[0]].shape
        count = max(AT_ONCE, AT_ONCE_PIXELS // (height * width))
        for first in range(0, len(missing), count):
            some = missing[first : first + count]
            pictures, finished = upscale_spaced_views(self._upscale, self._views, some, self._grid, self._stride)
            self._upscaled.update(zip(some, map(_Upscaled, pictures, finished), strict=True))
            self._samplings.update((view, each.sampling) for view, each in zip(some, finished, strict=True))

    def _fuse_rows(self, wanted: Iterable[View]) -> None:
        """Takes the mean of each of `wanted` and those beside it in its row, unless it is kept."""
        missing = _refresh_kept(self._rows, wanted)
        self._upscale_views({other for view in missing for other in list_line(view, self._grid, 1)})
        self._find_disparities(missing)
        self._run_each(self._fuse_row, missing)

    def _find_disparities(self, wanted: Iterable[View]) -> None:
        """Estimates the disparity of those of `wanted` for which it isn't kept."""
        missing = _refresh_kept(self._disparities, wanted)
        self._fetch_missing(other for view in missing for other in list_cross(view, self._grid))
        self._upscale_views(missing)  # finds the range of their disparities
        self._run_each(self._find_disparity, missing)

    def _find_disparity(self, view: View) -> None:
        small = self._views[view]
        contrast = _measure_contrast(small)
        beside = {
            (v - view[0], u - view[1]): compute_luma(self._views[v, u], contrast)
            for v, u in list_cross(view, self._grid)
            if (v, u) != view
        }
        limits = Range(*(limit / self._stride for limit in self._upscaled[view].finishing.disparities))
        step = FINE_STEP if self._matches else STEP
        self._disparities[view] = estimate_disparity(compute_luma(small, contrast), beside, limits, step=step)

    def _fuse_row(self, view: View) -> None:
        picture = self._upscaled[view].picture
        contrast = _measure_contrast(self._views[view])
        beside = {
            u - view[1]: compute_luma(self._upscaled[v, u].picture, contrast)
            for v, u in list_line(view, self._grid, 1)
            if u != view[1]
        }
        fused = fuse_lumas(compute_luma(picture, contrast), beside, self._disparities[view], 1)
        fused *= np.float32(contrast * _count_levels(picture))
        self._rows[view] = np.rint(fused).clip(0, LEVELS).astype(np.uint16)

    def _find_sampling(self, view: View) -> Sampling | None:
        """Returns how `view` was sampled. If that is unknown, it is assumed to be means like most of its block."""
        block = list_block(view, self._grid)
        return self._samplings[view] or find_common_means([self._samplings[other] for other in block])

    def _fuse(self, view: View, picture: Pixels, sampling: Sampling | None, cores: int) -> bool:
        """Changes `picture`, the upscaled `view`, to the mean of its block, on `cores` cores, and returns whether it
        was matched as well. All channels change by as much as luma.
        """
        small = self._views[view]
        contrast = _measure_contrast(small)
        unit = np.float32(1 / (contrast * _count_levels(picture)))
        column = {v - view[0]: self._rows[v, u] * unit for v, u in list_line(view, self._grid, 0)}
        fused = fuse_lumas(column.pop(0), column, self._disparities[view], 0)
        noise = sampling.noise * (JPEG_NOISE if self._is_jpeg else 1) if sampling else 0.0
        own = self._samplings[view]  # not a guess from those around it: matching by the wrong sampling does harm
        matched = self._matches and own is not None and own.likeness == 1 and own.gain > 0
        if matched and sampling:
            seen = {
                (v - view[0], u - view[1]): Seen(compute_luma(self._views[v, u], contrast), self._disparities[v, u])
                for v, u in list_nearest(view, self._grid)
            }
            peak = np.iinfo(small.dtype).max >> count_raised_bits(small, picture)  # of which noise is a share
            unsure = MATCHING_NOISE * noise * peak / contrast
            fused = match_views(fused, seen.pop((0, 0)), seen, sampling.kind, noise=unsure, cores=cores)
        change = np.rint(fused * np.float32(contrast) - compute_luma(picture, 1)).astype(np.int32)
        for channel in np.moveaxis(picture, -1, 0):
            channel[...] = np.clip(channel + change, 0, np.iinfo(picture.dtype).max)
        if sampling and sampling.gain:
            unused = count_raised_bits(small, picture)  # others of its block may be brighter
            raised, seen_pixels = raise_levels(picture, unused), raise_levels(small, unused)
            restored = restore_luma(raised, seen_pixels, sampling.kind, gain=sampling.gain, noise=noise)
            picture[...] = lower_levels(restored, unused)
        return matched


def _measure_contrast(picture: Pixels) -> float:
    """Returns the root mean square of the range of 3x3 pixels, in levels; 1 if the picture is flat."""
    return float(np.sqrt(np.mean(np.square(measure_contrast(compute_luma(picture, 1)))))) or 1.0


def _count_levels(picture: Pixels) -> int:
    """Counts the 16-bit levels for each level of `picture`."""
    return LEVELS // int(np.iinfo(picture.dtype).max)


def _refresh(kept: dict[View, Value], latest: Mapping[View, Value]) -> None:
    """Adds the `latest` entries to `kept`, or moves them to its end."""
    for view, value in latest.items():
        kept.pop(view, None)
        kept[view] = value


def _refresh_kept(kept: dict[View, Value], views: Iterable[View]) -> list[View]:
    """Moves those of `views` that are in `kept` to its end, and returns the others, in order."""
    ordered = sorted(set(views))
    _refresh(kept, {view: kept[view] for view in ordered if view in kept})
    return [view for view in ordered if view not in kept]


def _shorten(kept: dict[View, Value], most: int) -> None:
    """Removes the oldest entries, so that at most `most` stay."""
    for view in list(kept)[: max(0, len(kept) - most)]:
        del kept[view]
