"""Schedules views in batches, so that each view is made once and kept only as long as another one needs it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.views import View
    from ciir.service.pipeline.stages.arrangement import Arrangement

BATCH_PIXELS = 500_000
"""Most output pixels of a batch of several views. It bounds memory, and lets the stages overlap."""


@dataclass(frozen=True)
class Batch:
    """Views that are upscaled and written together."""

    wanted: Sequence[View]
    """The views to upscale and write."""
    new: Sequence[View]
    """The views to make first: those of `wanted` and of their windows that no earlier batch has made."""
    done: Sequence[View]
    """The views that no later batch needs."""


def batch_size(pixels: int) -> int:
    """Returns how many views of `pixels` output pixels make a batch; at least one."""
    return max(1, BATCH_PIXELS // pixels)


def schedule_batches(
    wanted: Sequence[View], arrangement: Arrangement, *, size: int, is_light_field: bool
) -> list[Batch]:
    """Splits `wanted`, in order, into batches of `size` views; for a light-field model, with their windows' views."""
    parts = [wanted[first : first + size] for first in range(0, len(wanted), size)]
    windows = [arrangement.list_required(part) for part in parts] if is_light_field else parts
    first_use = {view: number for number, window in reversed(list(enumerate(windows))) for view in window}
    last_use = {view: number for number, window in enumerate(windows) for view in window}
    return [
        Batch(
            part,
            new=[view for view in window if first_use[view] == number],
            done=[view for view in window if last_use[view] == number],
        )
        for number, (part, window) in enumerate(zip(parts, windows, strict=True))
    ]
