"""Finishes a view after the light-field network: single-picture fallback, and corrections for the view's sampling."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models.back_projection import restore_luma
from ciir.models.light_field.pixels import blend_pictures
from ciir.models.light_field.planes import Range

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ciir.models.light_field.disparities.shifts import Pixels, Plane
    from ciir.models.sampling import Sampling

CONFIDENT, UNCERTAIN = 0.8, 1.2
"""Up to the first uncertainty the light-field network's picture is used, from the second the fallback's. Views of one
scene have 0.3 to 0.6 (nine tenths of all pixels), with noise 0.5 to 0.9; views of other scenes have 1 or more. The
values were chosen for the best mean over the light fields of `ciir bench --harm`."""
MINIMUM_FALLBACK_SHARE = 0.15
"""The fallback is used if its share of a view, because of low confidence, is larger than this. Silhouettes always need
some. Below this share the fallback gains nothing (-0.002 dB on average over 245 views of the harm benchmark) and takes
half of the time."""
LARGEST_MISALIGNMENT = 0.29
"""Distance, LR pixels, of a view's direct neighbours from where they should be (`ranges.Tiles`), above which the
fallback makes the whole view. In captured and rendered light fields it is up to 0.23, also with noise and in JPEGs,
and up to 0.289 in the 289 views that a gantry took with small errors. If each view is moved by up to 0.5 pixels along
both axes it is 0.25 to 0.7, and the light-field network is worse than the fallback from about 0.25 on. If each is
turned by up to half a degree, it is 0.1 to 0.5."""
FALLBACK_SHARES = {1: (0.3, 0.45), 2: (0.1, 0.15)}
"""The fallback's share in the mean that replaces a filtered view, by the network's runs: for views with two others on
each side, and for all others, for which a light-field network is weaker. On five views of each of three captured light
fields with bicubic LR this gains 0.1 to 0.7 dB with `field` on average. The mean of two runs needs
less of it (docs/experiments.md)."""


class Finishing(NamedTuple):
    """How a view was finished after the network."""

    fallback: float = 0.0
    """The share of pixels that come mostly from the single-picture fallback, because confidence is low."""
    interpolated: float = 0.0
    """The share of bicubic interpolation in a view that was upscaled by itself, or to which the fallback's picture was
    added (`models.single.finishing`)."""
    is_fused: bool = False
    """Whether the view is a mean with the upscaled views around it (`models.light_field.fusion`)."""
    is_matched: bool = False
    """Whether it was also brought closer to the views around it (`models.light_field.fusion.matching`)."""
    sampling: Sampling | None = None
    """How the view appears to have been sampled; None if that is unknown."""
    disparities: Range = Range(0.0, 0.0)
    """The range of its disparities, LR pixels from one view of its window to the next."""
    misalignment: float = 0.0
    """How far its direct neighbours are from where they should be, LR pixels."""

    @property
    def is_misaligned(self) -> bool:
        """Whether the fallback made the view because its neighbours are not where they should be."""
        return self.misalignment > LARGEST_MISALIGNMENT

    @property
    def is_averaged(self) -> bool:
        """Whether the view was filtered and is the mean of both networks."""
        return self.sampling is not None and self.sampling.kind == "filter"

    @property
    def is_restored(self) -> bool:
        """Whether the view was brought closer to its input by back-projection."""
        return self.sampling is not None and self.sampling.gain > 0


def finish_view(
    picture: NDArray[np.uint16],
    small: Pixels,
    uncertainty: Plane,
    sampling: Sampling | None,
    upscale_alone: Callable[[], tuple[NDArray[np.uint16], float]],
    *,
    is_surrounded: bool,
    runs: int,
    disparities: Range,
    misalignment: float,
) -> Finishing:
    """Changes `picture` `(scale*H, scale*W, C)`, 16 bits, in place. A light-field network made it from `small`
    `(H, W, C)`, 8 or 16 bits.

    A `misalignment` over `LARGEST_MISALIGNMENT` replaces it by the fallback's picture, and nothing else is done.

    Between `CONFIDENT` and `UNCERTAIN` of `uncertainty` `(H, W)` it is blended with the fallback's picture, if that
    would make up more than `MINIMUM_FALLBACK_SHARE` of the view. If the view was downscaled with an antialiasing
    filter, it becomes a mean with the fallback's picture; if it has no noise, it is brought closer to its input
    (`models.back_projection.restore_luma`). `upscale_alone` returns the fallback's picture and the share of
    interpolation in it. `is_surrounded`: whether there are two views on each side. `runs`: how many runs of the network
    `picture` is the mean of. `disparities`: the range that was measured in the view, for the result.
    """
    finishing = Finishing(1.0, disparities=disparities, misalignment=misalignment)
    if finishing.is_misaligned:
        picture[...], interpolated = upscale_alone()
        return finishing._replace(interpolated=interpolated)
    weight = np.clip((uncertainty - CONFIDENT) / (UNCERTAIN - CONFIDENT), 0, 1)
    if np.mean(weight) <= MINIMUM_FALLBACK_SHARE:
        weight[:] = 0
    share = float(np.mean(weight > 0.5))
    finishing = finishing._replace(fallback=share, sampling=sampling)
    if sampling and finishing.is_averaged:
        surrounded, other = FALLBACK_SHARES[runs]
        most = surrounded if is_surrounded else other
        np.maximum(weight, np.float32(most * sampling.likeness), out=weight)
    if weight.any():
        alone, interpolated = upscale_alone()
        blend_pictures(picture, alone, weight)
        finishing = finishing._replace(interpolated=interpolated * float(weight.mean()))
    if sampling and finishing.is_restored:
        picture[...] = restore_luma(picture, small, sampling.kind, gain=sampling.gain, noise=sampling.noise)
    return finishing
