"""Limits on inputs, from the environment, and limits on what one job may ask for, checked before any view is made."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING, Literal

from ciir.errors import InvalidOption, TooLarge
from ciir.models.catalogue import FALLBACK
from ciir.renderer.limits import Limits
from ciir.renderer.readers.pictures import MAX_SIDE

if TYPE_CHECKING:
    from ciir.renderer.lens_array import LensArray

Strategy = Literal["upscale", "direct"]
MAX_VIEW_PIXELS = 64_000_000
"""Most pixels in one view, in or out: the same as for a picture that is read."""
MAX_VIEW_SAMPLES = 64_000_000
"""Most points of a mesh sampled for one view. Memory grows by about 10 bytes for each."""
SETTINGS = {
    "files": ("CIIR_MAX_FILES", 1, 1_000_000),
    "bytes": ("CIIR_MAX_UNPACKED_BYTES", 1024, 2**40),
    "ratio": ("CIIR_MAX_RATIO", 1, 100_000),
    "pixels": ("CIIR_MAX_PIXELS", 1, 2**40),
    "set_bytes": ("CIIR_MAX_SET_BYTES", 1, 2**40),
    "triangles": ("CIIR_MAX_TRIANGLES", 1, 100_000_000),
    "views": ("CIIR_MAX_VIEWS", 1, 16_777_216),
}
"""Each limit of `renderer.limits.Limits` -> the environment variable that sets it, its least and its largest value."""


def read_limits() -> Limits:
    """Reads the limits on inputs from the environment. Raises `InvalidOption`."""
    given: dict[str, int] = {}
    for field, (name, least, most) in SETTINGS.items():
        text = os.environ.get(name, "").strip()
        if not text:
            continue
        if re.fullmatch(r"\d{1,15}", text) is None or not least <= int(text) <= most:
            raise InvalidOption(
                f"{name}: {text[:40]!r} is not a whole number from {least} to {most}; "
                f"set one, or unset it for the default {getattr(Limits, field)}"
            )
        given[field] = int(text)
    return Limits(**given)


def describe_setting(error: TooLarge) -> str:
    """Returns what to add to the message of `error`: what to type for ten times the limit, or for what is needed.

    Empty if no setting raises the limit.
    """
    if not error.limit:
        return ""
    name, _, most = SETTINGS[error.limit]
    raised = max(10 * getattr(read_limits(), error.limit), error.needed)
    return f", or type {name}={min(raised, most)} before the command"


def check_view_count(spec: str, grid: tuple[int, int], limit: int) -> None:
    """Raises `TooLarge` if `spec`, with `;` between views, names more than `limit` of the views of `grid`."""
    if spec == "all" and grid[0] * grid[1] > limit:
        raise TooLarge(
            f"views: all of {grid[0]}x{grid[1]} are over the limit of {limit:,}; name some, or fewer pixels", "views"
        )
    if spec.count(";") >= limit + spec.endswith(";"):
        raise TooLarge(f"views: {spec.count(';') + 1:,} are over the limit of {limit:,}; name fewer", "views")


def check_frame_count(count: int, limit: int) -> None:
    """Raises `TooLarge` for more than `limit` times or yaws, each of which is a view."""
    if count > limit:
        raise TooLarge(f"time, rotate: {count:,} frames are over the limit of {limit:,}; give fewer", "views")


def check_size(
    size: tuple[int, int],
    scale: int,
    *,
    count: int = 1,
    limit: int | None = None,
    what: str = "a view",
    remedy: str = "a smaller input",
) -> None:
    """Raises `TooLarge` if a view of `size` (rows, columns) times `scale` has too many pixels, or if `count` views
    together have more than `limit`. `remedy`: what makes `size` smaller.
    """
    rows, cols = size[0] * scale, size[1] * scale
    if rows * cols > MAX_VIEW_PIXELS or max(rows, cols) > MAX_SIDE:
        grown = "" if scale == 1 else f", {scale} times {size[0]}x{size[1]},"
        raise TooLarge(
            f"{what}: {rows}x{cols} pixels{grown} are over the limit of {MAX_VIEW_PIXELS:,}, or of {MAX_SIDE:,} a "
            f"side; give a smaller scale or {remedy}"
        )
    if limit is not None and count * rows * cols > limit:
        given = f"{what} of" if count == 1 else f"{count} views of"
        fewer = "" if count == 1 else "fewer views, "
        raise TooLarge(
            f"{given} {rows}x{cols} pixels: {count * rows * cols:,} are over the limit of {limit:,}; "
            f"ask for {fewer}a smaller scale or {remedy}"
        )


def _list_remedies(strategy: Strategy, samples: int, *others: str) -> str:
    """Lists `others` and what else makes fewer samples of a mesh with `samples x samples` points for each pixel."""
    fewer = ["a smaller scale", "strategy upscale"] if strategy == "direct" else ["sampling pinhole"] * (samples > 1)
    listed = [*others, "fewer lenses", *fewer]
    return " or ".join(part for part in (", ".join(listed[:-1]), listed[-1]) if part)


def check_view_samples(array: LensArray, samples: int, strategy: Strategy) -> None:
    """Raises `TooLarge` if a view of `array` with `samples x samples` points for each pixel has too many points."""
    points = array.rows * array.cols * samples**2
    if points > MAX_VIEW_SAMPLES:
        raise TooLarge(
            f"a view of {array.rows}x{array.cols} pixels with {samples}x{samples} samples each is {points:,} samples, "
            f"over the limit of {MAX_VIEW_SAMPLES:,}; give {_list_remedies(strategy, samples)}"
        )


def check_samples(
    points: int, count: int, limit: int | None, strategy: Strategy, *, samples: int, neighbours: int = 0
) -> None:
    """Raises `TooLarge` if `count` views with `points` samples each, `samples x samples` for a pixel, are over `limit`.

    `neighbours`: how many of them are rendered only because a light-field network needs them.
    """
    if limit is not None and count * points > limit:
        others = ("fewer views", *([f"model {FALLBACK}"] if neighbours else []))
        around = f", {neighbours} of them around those asked for," if neighbours else ""
        raise TooLarge(
            f"{count} views of {points:,} samples each{around} are {count * points:,}, over the limit of {limit:,}; "
            f"ask for {_list_remedies(strategy, samples, *others)}"
        )


def check_eia(array: LensArray) -> None:
    """Raises `TooLarge` if a mesh's elemental image array would have more pixels than a picture may have."""
    height, width = array.rows * array.pixels_v, array.cols * array.pixels_u
    if height * width > MAX_VIEW_PIXELS or max(height, width) > MAX_SIDE:
        raise TooLarge(
            f"an elemental image array of {height}x{width} pixels is over the limit of {MAX_VIEW_PIXELS:,}, or of "
            f"{MAX_SIDE:,} a side; give fewer lenses or fewer pixels"
        )
