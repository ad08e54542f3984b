"""In which order views are made and upscaled, so that each is made once and kept no longer than it is needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ciir.models.light_field.views import list_required_views

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.views import View


BATCH_PIXELS = 500_000
"""Output pixels of one turn, in whole views: what bounds memory, and lets the stages overlap where views are many."""


@dataclass(frozen=True)
class Turn:
    """A few views, and what is made and let go of for them."""

    wanted: Sequence[View]
    """What is upscaled and written."""
    new: Sequence[View]
    """What is made first: of `wanted` and of the views that it needs, those that no turn before has made."""
    done: Sequence[View]
    """What no later turn needs."""


def at_once(pixels: int) -> int:
    """How many views of so many output pixels are worked on in one turn."""
    return max(1, BATCH_PIXELS // pixels)


def turns(wanted: Sequence[View], grid: tuple[int, int], *, together: int, is_light_field: bool) -> list[Turn]:
    """`wanted` in order, `together` at a time; for a light-field model with the views of their windows.

    Where all views are wanted row by row, those of 5 rows of `grid` and of one turn are kept at a time.
    """
    parts = [wanted[first : first + together] for first in range(0, len(wanted), together)]
    windows = [list_required_views(part, grid) for part in parts] if is_light_field else parts
    made = {view: number for number, window in reversed(list(enumerate(windows))) for view in window}
    last = {view: number for number, window in enumerate(windows) for view in window}
    return [
        Turn(
            part,
            new=[view for view in window if made[view] == number],
            done=[view for view in window if last[view] == number],
        )
        for number, (part, window) in enumerate(zip(parts, windows, strict=True))
    ]
