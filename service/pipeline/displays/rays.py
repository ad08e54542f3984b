"""The number of rays for a display picture of a mesh."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ciir.errors import TooLarge
from ciir.renderer.displays.integral import IntegralDisplay
from ciir.renderer.displays.lenticular import Calibration
from ciir.renderer.sampling import DISPLAY_SAMPLES, LENSLET_SAMPLES

if TYPE_CHECKING:
    from ciir.renderer.displays.pictures import Target
    from ciir.service.pipeline.options import Options


def count_rays(target: Target, options: Options) -> int:
    """Counts rays of the picture: one for each subpixel of a native picture, else `find_samples` along each side."""
    if isinstance(target, Calibration):
        return 3 * target.width * target.height
    if isinstance(target, IntegralDisplay):
        return 3 * target.width * target.height * find_samples(options) ** 2
    return target.layout.count * math.prod(target.tile) * find_samples(options) ** 2


def find_samples(options: Options) -> int:
    """Returns the number of rays along each side of a quilt's pixel, or of a panel's subpixel."""
    return LENSLET_SAMPLES if options.sampling == "lenslet" else DISPLAY_SAMPLES


def check_rays(count: int, limit: int | None, options: Options) -> None:
    """Raises `TooLarge` for more than `limit` rays."""
    if limit is not None and count > limit:
        remedy = "a lower dpi" if options.print else "a display with fewer pixels"
        sampling = ", or leave sampling out" if options.sampling == "lenslet" else ""
        raise TooLarge(f"a picture of {count:,} rays is over the limit of {limit:,}; give {remedy}{sampling}")
