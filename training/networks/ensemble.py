"""Several of our generators side by side, whose changes are added: an ensemble, trained as one network.

Where it starts from one generator (`split_weights`), each member is turned by another quarter (geometric self-ensemble:
EDSR, Lim et al., CVPRW 2017). The turn is in its kernels: no picture is turned when the network runs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

from torch import Tensor, nn
from torch.nn import functional

from ciir.training.networks.compact import CompactGenerator
from ciir.training.networks.guard import COLOURS, limit_change

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class Ensemble(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`.

    ::

        image = PixelShuffle(limit(change_1(image) + ... + change_n(image)) + bicubic(image))
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
    ) -> None:
        """`members`: how many generators. `guard`: whether the sum is limited (`guard.limit_change`). The other options
        are of each: see `compact.CompactGenerator`. Raises `ValueError` for less than one member.
        """
        if members < 1:
            raise ValueError(f"members is {members}; give 1 or more")
        super().__init__()
        self.scale, self.guard = scale, guard
        self.members = nn.ModuleList(CompactGenerator(widths, scale, slope, rounded=rounded) for _ in range(members))

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        members = [cast("CompactGenerator", member) for member in self.members]
        changes = [member.compute_change(image) for member in members]
        change = sum(changes[1:], start=changes[0])
        if self.guard:
            change = limit_change(change, image)
        return functional.pixel_shuffle(change + members[0].base(image), self.scale)


def split_weights(found: Mapping[str, Tensor], members: int) -> dict[str, Tensor]:
    """Makes an ensemble's weights out of one generator's plain ones, by name: without a limit it computes the mean of
    what the generator makes of a picture that is turned by 0, 1, 2, ... quarters, turned back.
    """
    made = {}
    for member in range(members):
        for name, weight in found.items():
            turned = weight.rot90(-member, (2, 3)) if weight.ndim == 4 else weight
            outputs = weight.shape[0] if weight.ndim else 0  # the file holds other constants too
            side = math.isqrt(outputs // COLOURS)  # of the phases, which turn too
            if name.startswith("tail.") and outputs == COLOURS * side**2:
                phases = turned.reshape(COLOURS, side, side, *weight.shape[1:])
                turned = phases.rot90(-member, (1, 2)).reshape(weight.shape) / members
            made[f"members.{member}.{name}"] = turned
    return made


def count_members(found: Mapping[str, Tensor]) -> int:
    """How many generators these weights are of, by their names; 0 for those of no ensemble."""
    return len({name.split(".")[1] for name in found if name.startswith("members.")})
