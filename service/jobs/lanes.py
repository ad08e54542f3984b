"""Two queues, so that small jobs never wait behind large ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.service.pipeline.job import LENSES, PIXELS
from ciir.service.pipeline.options import Options

if TYPE_CHECKING:
    from ciir.service.jobs.job import Lane, Request

LANES: tuple[Lane, ...] = ("small", "large")
SMALL_BYTES = 4 << 20
SMALL_PIXELS = 2_000_000
LARGE_FIRST_EVERY = 4
"""A thread prefers the large queue for one job in so many, so that large jobs run while small ones keep coming."""


def choose_lane(request: Request, size: int) -> Lane:
    """`small` for a file of up to `SMALL_BYTES` whose output is up to `SMALL_PIXELS`, as estimated from the options."""
    options = Options.parse(request.options)
    rows, cols = options.lenses or LENSES
    pixels = options.pixels or PIXELS
    views = {"center": 1, "cross": 5, "all": pixels[0] * pixels[1]}.get(options.views, options.views.count(";") + 1)
    is_small = size <= SMALL_BYTES and rows * cols * options.scale**2 * views <= SMALL_PIXELS
    return "small" if is_small else "large"


def order_lanes(thread: int, threads: int, count: int) -> tuple[Lane, ...]:
    """The queues to try, in order, for job number `count` of consumer thread `thread` of `threads`."""
    if thread == 0 and threads > 1:
        return ("small",)
    return ("large", "small") if count % LARGE_FIRST_EVERY == LARGE_FIRST_EVERY - 1 else ("small", "large")
