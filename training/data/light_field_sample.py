"""A light field of a window of views with its truth, as training and validation take it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from torch import Tensor


class Inputs(NamedTuple):
    """What `training.networks.light_field.LightFieldGenerator` takes, by its names."""

    image: Tensor
    around: Tensor
    rows: Tensor
    cols: Tensor


class MeshLightField(NamedTuple):
    """A mesh's light field, 8 bit: for each kind of array the luma of all views of a window `(25, h, w)` and the middle
    one in colour `(3, h, w)`; and its truth `(3, 2*h, 2*w)`.
    """

    views: dict[str, Tensor]
    colours: dict[str, Tensor]
    high: Tensor
