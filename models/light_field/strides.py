"""Windows of every second or third view, which help more than adjacent views if content hardly moves between views.

Such views form a light field of their own, which has its own border.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ciir.models.light_field.views import join_groups
from ciir.models.light_field.windows import WINDOW_SIDE, list_required_views

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from ciir.models.light_field.disparities.shifts import Pixels
    from ciir.models.light_field.finishing import Finishing
    from ciir.models.light_field.windows import View

    UpscaleViews = Callable[[Mapping[View, Pixels], Sequence[View], tuple[int, int]], tuple[Pixels, list[Finishing]]]

MOVED = 0.72
"""Most pixels that content may move by from one view of a window to the next; see docs/experiments.md."""
MOST = 3
"""The largest stride."""


def choose_stride(motion: float | None, grid: tuple[int, int]) -> int:
    """Chooses the stride that helps best in a grid of `grid` views whose content moves by `motion` pixels from one view
    to the next; 1 if that isn't known. With the chosen stride every view still has a whole window.
    """
    if motion is None:
        return 1
    most = max(1, min(MOST, min(grid) // WINDOW_SIDE))
    return max(1, most if motion * most <= MOVED else int(MOVED / motion))


class _Part(NamedTuple):
    """The part of a grid that consists of every `stride`-th view."""

    first: View
    grid: tuple[int, int]


def _find_part(view: View, grid: tuple[int, int], stride: int) -> tuple[_Part, View]:
    """Returns the part that `view` is in, and its place there."""
    v, u = (number % stride for number in view)
    part = _Part((v, u), (-(-(grid[0] - v) // stride), -(-(grid[1] - u) // stride)))
    return part, (view[0] // stride, view[1] // stride)


def list_spaced_views(wanted: Sequence[View], grid: tuple[int, int], stride: int) -> list[View]:
    """Lists every view of the windows of every `stride`-th view around `wanted`, row by row and each once."""
    required = set()
    for view in wanted:
        part, place = _find_part(view, grid, stride)
        v, u = part.first
        required |= {(v + stride * row, u + stride * col) for row, col in list_required_views([place], part.grid)}
    return sorted(required)


def upscale_spaced_views(
    upscale: UpscaleViews,
    views: Mapping[View, Pixels],
    wanted: Sequence[View],
    grid: tuple[int, int],
    stride: int,
) -> tuple[Pixels, list[Finishing]]:
    """Upscales views with windows of every `stride`-th view. `upscale`: `models.light_field.views.upscale_views` with
    its models already given. `views`: at least those of `list_spaced_views`.
    """
    by_part: dict[_Part, list[int]] = {}
    for number, view in enumerate(wanted):
        by_part.setdefault(_find_part(view, grid, stride)[0], []).append(number)
    made = []
    for part, numbers in by_part.items():
        inside = {}
        for view, picture in views.items():
            own, place = _find_part(view, grid, stride)
            if own == part:
                inside[place] = picture
        places = [_find_part(wanted[number], grid, stride)[1] for number in numbers]
        made.append(upscale(inside, places, part.grid))
    return join_groups(list(by_part.values()), made)
