"""Two queues, so that many small requests never wait behind large ones, and who takes from which."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.service.pipeline.options import Options
from ciir.service.pipeline.plan import LENSES, PIXELS

if TYPE_CHECKING:
    from ciir.service.jobs.job import Lane, Request

LANES: tuple[Lane, ...] = ("small", "large")
SMALL_BYTES = 4 << 20
SMALL_PIXELS = 2_000_000
FAIR_TURN = 4
"""Of so many turns a consumer begins one with the large ones, so that they get through while small ones keep coming."""


def lane(request: Request, size: int) -> Lane:
    """`small` for a file of up to `SMALL_BYTES` that makes up to `SMALL_PIXELS`, as far as the options show.

    Output pixels are the lenses times `scale` squared for each view; counts that aren't given are a mesh's defaults, as
    nothing is decoded here. A guess by which jobs are put in order, no limit.
    """
    options = Options.parse(request.options)
    rows, cols = options.lenses or LENSES
    pixels = options.pixels or PIXELS
    views = {"center": 1, "cross": 5, "all": pixels[0] * pixels[1]}.get(options.views, options.views.count(";") + 1)
    is_small = size <= SMALL_BYTES and rows * cols * options.scale**2 * views <= SMALL_PIXELS
    return "small" if is_small else "large"


def order(thread: int, threads: int, turn: int) -> tuple[Lane, ...]:
    """The queues from which consumer thread `thread` of `threads` takes its next job, first choice first.

    Thread 0 is kept for small jobs where there is another. The others take small ones first, but in one turn of
    `FAIR_TURN`.
    """
    if thread == 0 and threads > 1:
        return ("small",)
    return ("large", "small") if turn % FAIR_TURN == FAIR_TURN - 1 else ("small", "large")
