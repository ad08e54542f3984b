"""Upscales views, and fuses some of them with the upscaled views around them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from ciir.bit_depth import count_unused_bits, lower_levels, raise_levels
from ciir.models.back_projection import measure_contrast, restore_luma
from ciir.models.light_field.fusion.disparity import estimate_disparity
from ciir.models.light_field.fusion.pixels import fuse_lumas
from ciir.models.light_field.network import compute_luma
from ciir.models.light_field.planes import Range
from ciir.models.light_field.strides import list_spaced_views, upscale_spaced_views
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.models.parallel import run_each

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from ciir.models.light_field.disparities.shifts import Pixels
    from ciir.models.light_field.finishing import Finishing
    from ciir.models.light_field.fusion import Fusion
    from ciir.models.light_field.strides import UpscaleViews
    from ciir.models.light_field.windows import View

Value = TypeVar("Value")

BLOCK_SIDE = 3
"""Views along each side of the block whose mean a fused view is."""
AT_ONCE = 4
"""Most views that are upscaled at once, to save memory."""
JPEG_NOISE = 3.0
"""Factor on the differences from the input that count as noise, so that little of a JPEG's errors comes back."""
MOST_PIXELS = 100_000
"""Largest views, in pixels, that `auto` fuses. A single one of that size takes 1.5 seconds more on two cores."""


class _Made(NamedTuple):
    """An upscaled view."""

    picture: Pixels
    finishing: Finishing


def explain_no_fusion(pixels: int, stride: int) -> str:
    """Says why `auto` fuses no views of `pixels` pixels whose windows have `stride`; empty if it may."""
    if pixels > MOST_PIXELS:
        return f"views of more than {MOST_PIXELS:,} pixels take long"
    return "content moves little from view to view, so neighbours have much the same errors" if stride > 1 else ""


def list_block(view: View, grid: tuple[int, int]) -> list[View]:
    """Lists the 3x3 views around `view` in a grid of `grid` views, and `view` itself, row by row. At the border of the
    grid the block is moved inwards.
    """
    firsts = (max(0, min(place - BLOCK_SIDE // 2, count - BLOCK_SIDE)) for place, count in zip(view, grid, strict=True))
    rows, cols = (range(first, min(first + BLOCK_SIDE, count)) for first, count in zip(firsts, grid, strict=True))
    return [(v, u) for v in rows for u in cols]


def list_fused_views(wanted: Sequence[View], grid: tuple[int, int], stride: int) -> list[View]:
    """Lists every view that `FusingUpscaler` may need for `wanted`, row by row and each once."""
    blocks = sorted({other for view in wanted for other in list_block(view, grid)})
    return list_spaced_views(blocks, grid, stride)


class FusingUpscaler:
    """Upscales views of a grid, and replaces some of them by the means of their blocks' upscaled views.

    A view's result doesn't depend on which others are wanted. The latest views are kept, so that each is upscaled once
    if views are wanted row by row, or column by column.
    """

    def __init__(
        self,
        upscale: UpscaleViews,
        grid: tuple[int, int],
        stride: int,
        *,
        fusion: Fusion,
        is_jpeg: bool,
        fetch: Callable[[Sequence[View]], Mapping[View, Pixels]],
        cores: int,
    ) -> None:
        """`upscale`, `grid`, `stride`: as for `upscale_spaced_views`. `is_jpeg`: whether the views are those of a JPEG
        array. `fetch`: returns views that a call didn't give. `cores`: most views that are fused at once.
        """
        self._upscale, self._grid, self._stride = upscale, grid, stride
        self._fusion, self._is_jpeg = fusion, is_jpeg
        self._fetch, self._cores = fetch, cores
        longest = max(grid)
        self._most_made = BLOCK_SIDE * (longest + 2)
        self._most_views = (BLOCK_SIDE - 1 + WINDOW_SIDE * stride) * longest
        self._views: dict[View, Pixels] = {}
        self._made: dict[View, _Made] = {}

    def __call__(self, views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, list[Finishing]]:
        """Upscales the views `wanted`, as `models.light_field.views.upscale_views` does."""
        if self._fusion == "never":
            return upscale_spaced_views(self._upscale, views, wanted, self._grid, self._stride)
        _refresh(self._views, views)
        self._make(wanted)
        finished = [self._made[view].finishing for view in wanted]
        numbers = [number for number, finishing in enumerate(finished) if self._is_fused(finishing)]
        self._make(sorted({other for number in numbers for other in list_block(wanted[number], self._grid)}))
        result: Any = np.stack([self._made[view].picture for view in wanted])

        def fuse(number: int) -> None:
            self._fuse(wanted[number], result[number])
            finished[number] = finished[number]._replace(is_fused=True)

        run_each(fuse, numbers, min(self._cores, max(1, len(numbers))))
        _shorten(self._made, self._most_made)
        _shorten(self._views, self._most_views)
        return result, finished

    def _is_fused(self, finishing: Finishing) -> bool:
        return self._fusion == "always" or self._is_jpeg or finishing.is_averaged

    def _make(self, wanted: Sequence[View]) -> None:
        """Upscales those of `wanted` that are not kept."""
        missing = [view for view in wanted if view not in self._made]
        _refresh(self._made, {view: self._made[view] for view in wanted if view in self._made})
        if not missing:
            return
        absent = [view for view in list_spaced_views(missing, self._grid, self._stride) if view not in self._views]
        if absent:
            self._views.update(self._fetch(absent))
        for first in range(0, len(missing), AT_ONCE):
            some = missing[first : first + AT_ONCE]
            pictures, finished = upscale_spaced_views(self._upscale, self._views, some, self._grid, self._stride)
            self._made.update(zip(some, map(_Made, pictures, finished), strict=True))

    def _fuse(self, view: View, picture: Pixels) -> None:
        """Changes `picture`, the upscaled `view`, to the mean of its block. All channels change by as much as luma."""
        finishing = self._made[view].finishing
        others = {(v - view[0], u - view[1]): (v, u) for v, u in list_block(view, self._grid) if (v, u) != view}
        small = self._views[view]
        contrast = float(np.sqrt(np.mean(np.square(measure_contrast(compute_luma(small, 1))))))
        if not contrast:
            return
        own = compute_luma(picture, contrast)
        disparity = estimate_disparity(
            compute_luma(small, contrast),
            {offset: compute_luma(self._views[other], contrast) for offset, other in others.items() if 0 in offset},
            Range(*(limit / self._stride for limit in finishing.disparities)),
        )
        around = {offset: compute_luma(self._made[other].picture, contrast) for offset, other in others.items()}
        change = np.rint((fuse_lumas(own, around, disparity) - own) * np.float32(contrast)).astype(np.int32)
        for channel in np.moveaxis(picture, -1, 0):
            channel[...] = np.clip(channel + change, 0, np.iinfo(picture.dtype).max)
        sampling = finishing.sampling
        if sampling and sampling.gain:
            unused = count_unused_bits(small, picture)  # others of its block may be brighter
            noise = sampling.noise * (JPEG_NOISE if self._is_jpeg else 1)
            raised, seen = raise_levels(picture, unused), raise_levels(small, unused)
            restored = restore_luma(raised, seen, sampling.kind, gain=sampling.gain, noise=noise)
            picture[...] = lower_levels(restored, unused)


def _refresh(kept: dict[View, Value], latest: Mapping[View, Value]) -> None:
    """Adds the `latest` entries to `kept`, or moves them to its end."""
    for view, value in latest.items():
        kept.pop(view, None)
        kept[view] = value


def _shorten(kept: dict[View, Value], most: int) -> None:
    """Removes the oldest entries, so that at most `most` stay."""
    for view in list(kept)[: max(0, len(kept) - most)]:
        del kept[view]
