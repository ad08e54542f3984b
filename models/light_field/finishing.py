"""Finishes a view after the light-field network: the single-image fallback, and what the view's sampling asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models.back_projection import restore_luma
from ciir.models.light_field.pixels import blend_pictures

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ciir.models.light_field.disparities.shifts import Pixels, Plane
    from ciir.models.light_field.sampling import Sampling

CONFIDENT, UNCERTAIN = 0.8, 1.2
"""Uncertainty up to which the light-field network's picture is taken, and from which the fallback's is. Views of one
scene have 0.3 to 0.6 (nine tenths of all pixels), with noise 0.5 to 0.9; views of other scenes 1 and more. Chosen for
the best mean over the light fields of `ciir bench --harm`."""
MINIMUM_FALLBACK_SHARE = 0.15
"""Share of a view that the fallback makes for low confidence, from which it is used: silhouettes always have some, and
below that it gains nothing (-0.002 dB in the mean of 245 views of the harm benchmark) in half of the time."""
SURROUNDED, MOST = 0.3, 0.45
"""The fallback's share in the mean that a filtered view becomes: with two views on each side, and otherwise, where the
light-field network is weaker. On five views of each of three captured light fields with bicubic LR it gains 0.1 to 0.7
dB with `field` and 0.1 to 0.4 with `field-quality` in the mean."""


class Finishing(NamedTuple):
    """How a view was finished after the light-field network."""

    fallback: float = 0.0
    """Share of pixels that come mostly from the single-image fallback, because confidence is low."""
    is_averaged: bool = False
    """Whether the view, which was filtered, is the mean of both networks."""
    is_restored: bool = False
    """Whether the view was brought closer to what was seen."""


def finish_view(
    picture: NDArray[np.uint16],
    small: Pixels,
    uncertainty: Plane,
    sampling: Sampling | None,
    upscale_alone: Callable[[], NDArray[np.uint16]],
    *,
    is_surrounded: bool,
) -> Finishing:
    """Changes `picture` `(scale*H, scale*W, C)` of 16 bits, which a light-field network made of `small` `(H, W, C)` of
    8 or 16, in place.

    From `CONFIDENT` to `UNCERTAIN` of `uncertainty` `(H, W)` it is blended with the fallback's, in a view of which that
    would make more than `MINIMUM_FALLBACK_SHARE`. One that was made small by an antialiasing filter becomes the mean
    with the fallback's, and one without noise is brought closer to what was seen
    (`models.back_projection.restore_luma`). `upscale_alone` makes the fallback's picture; `is_surrounded`: whether
    there are two views on each side.
    """
    weight = np.clip((uncertainty - CONFIDENT) / (UNCERTAIN - CONFIDENT), 0, 1)
    if np.mean(weight) <= MINIMUM_FALLBACK_SHARE:
        weight[:] = 0
    share = float(np.mean(weight > 0.5))
    is_filtered = sampling is not None and sampling.kind == "filter"
    if sampling and is_filtered:
        most = SURROUNDED if is_surrounded else MOST
        np.maximum(weight, np.float32(most * sampling.likeness), out=weight)
    if weight.any():
        blend_pictures(picture, upscale_alone(), weight)
    if sampling and sampling.gain:
        picture[...] = restore_luma(picture, small, sampling.kind, gain=sampling.gain, noise=sampling.noise)
    return Finishing(share, is_filtered, sampling is not None and sampling.gain > 0)
