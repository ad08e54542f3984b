"""Several of our generators side by side, whose changes are added: an ensemble.

If it starts from one generator (`split_weights`), each member is rotated by another quarter turn (geometric
self-ensemble: EDSR, Lim et al., CVPRW 2017). Only the kernels are rotated, not the pictures when the network runs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.compact import CompactGenerator
from ciir.training.networks.guard import COLOURS, limit_change
from ciir.training.networks.interpolation import BicubicReduction

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

ROUNDING = 1 / 255
"""The difference between an input and the reduced picture that rounding and the network's errors leave. If the
difference around a pixel is larger, the input was not made by bicubic reduction (a rendered view, for example), and the
difference is mostly left as it is."""
NEIGHBOURHOOD = 5
"""Side of the square around a pixel, LR pixels."""


class Ensemble(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`.

    ::

        image = PixelShuffle(limit(change_1(image) + ... + change_n(image)) + bicubic(image))

    `projected`: whether to use back-projection (Irani and Peleg, "Improving resolution by image registration", CVGIP
    53(3), 1991). The picture before the limit, after bicubic reduction, is compared with the input. The difference is
    interpolated and added to the changes, with a weight of `1 / (1 + m^2)`, where m is the mean of its square in the
    neighbourhood, in units of `ROUNDING^2`.
    """

    def __init__(
        self,
        widths: Sequence[int] = (32, 48, 48, 48, 48, 48, 48),
        scale: int = 2,
        slope: float = 0.0,
        members: int = 2,
        *,
        guard: bool = False,
        rounded: bool = False,
        projected: bool = False,
    ) -> None:
        """`members`: the number of generators. `guard`: whether the sum is limited (`guard.limit_change`). `projected`:
        see the class. The other options are those of each generator: see `compact.CompactGenerator`.

        Raises `ValueError` for fewer than one member.
        """
        if members < 1:
            raise ValueError(f"members is {members}; give 1 or more")
        super().__init__()
        self.scale, self.guard = scale, guard
        self.members = nn.ModuleList(CompactGenerator(widths, scale, slope, rounded=rounded) for _ in range(members))
        self.reduction = BicubicReduction(scale) if projected else None

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        members = [cast("CompactGenerator", member) for member in self.members]
        changes = [member.compute_change(image) for member in members]
        change, interpolate = sum(changes[1:], start=changes[0]), members[0].base
        interpolated = interpolate(image)
        if self.reduction is not None:
            change = change + interpolate(_weigh(image - self.reduction(change + interpolated)))
        if self.guard:
            change = limit_change(change, image)
        return functional.pixel_shuffle(change + interpolated, self.scale)


def _weigh(difference: Tensor) -> Tensor:
    """Multiplies a difference `(N, 3, H, W)` by its weight for back-projection (see `Ensemble`)."""
    power = (difference / ROUNDING).square().mean(1, keepdim=True)
    around = functional.avg_pool2d(power, NEIGHBOURHOOD, 1, NEIGHBOURHOOD // 2, count_include_pad=False)
    return difference / (1 + around.square())


def split_weights(found: Mapping[str, Tensor], members: int) -> dict[str, Tensor]:
    """Makes an ensemble's weights out of one generator's plain ones, by name.

    Without a limit the ensemble computes the mean of the generator's results for the picture rotated by 0, 1, 2, ...
    quarter turns, each rotated back.
    """
    made = {}
    for member in range(members):
        for name, weight in found.items():
            turned = weight.rot90(-member, (2, 3)) if weight.ndim == 4 else weight
            outputs = weight.shape[0] if weight.ndim else 0  # the file holds other constants too
            side = math.isqrt(outputs // COLOURS)  # of the phases, which rotate too
            if name.startswith("tail.") and outputs == COLOURS * side**2:
                phases = turned.reshape(COLOURS, side, side, *weight.shape[1:])
                turned = phases.rot90(-member, (1, 2)).reshape(weight.shape) / members
            made[f"members.{member}.{name}"] = turned
    return made


def count_members(found: Mapping[str, Tensor]) -> int:
    """Counts the generators of an ensemble by the names of its weights; 0 if they are not those of an ensemble."""
    return len({name.split(".")[1] for name in found if name.startswith("members.")})
