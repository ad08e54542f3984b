"""Limits the change that a generator adds to interpolation by the contrast of the picture there.

Nothing is added to a flat neighbourhood, and no colour to a grey one. So flat areas are exact and grey pictures stay
grey, even in int8, where a convolution of zeros is not quite zero.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch.nn import functional

if TYPE_CHECKING:
    from torch import Tensor

SIDE = 3
"""Side of the neighbourhood, LR pixels."""
COLOURS = 3


def limit_change(change: Tensor, image: Tensor, more: Tensor | None = None) -> Tensor:
    """Clamps `change`, `(N, 3 * phases, H, W)`, the phases of each colour one after the other, to the differences that
    `image`, `(N, 3, H, W)` RGB, has in the neighbourhood of each pixel.

    The mean of the colours changes by no more than the largest difference in any colour, and each colour's difference
    from that mean also by no more than the largest difference between colours. `more`, `(N, 1, H, W)`, is added to the
    largest difference, for the detail of other views.
    """
    highest, lowest = _pool(image), -_pool(-image)
    room = _largest(highest - lowest)
    if more is not None:
        room = room + more
    saturation = _pool(_largest(image) + _largest(-image))
    parts = change.chunk(COLOURS, 1)
    mean = (parts[0] + parts[1] + parts[2]) * (1 / COLOURS)
    kept = _clamp(mean, room)
    colour = torch.minimum(room, saturation)
    return torch.cat([kept + _clamp(part - mean, colour) for part in parts], 1)


def _pool(image: Tensor) -> Tensor:
    return functional.max_pool2d(image, SIDE, 1, SIDE // 2)


def _largest(image: Tensor) -> Tensor:
    """Returns the largest of three colours, `(N, 1, H, W)`."""
    red, green, blue = image.chunk(COLOURS, 1)
    return torch.maximum(torch.maximum(red, green), blue)


def _clamp(x: Tensor, most: Tensor) -> Tensor:
    return torch.maximum(torch.minimum(x, most), -most)
