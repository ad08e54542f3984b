"""A case of the harm table: a low-resolution light field or picture, the wanted view, and its truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ciir.renderer.light_field import LightField
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View
    from ciir.service.pipeline.options import Options

SCALE = 2
Kind = Literal["mesh", "light field", "picture"]
MESH: Kind = "mesh"
LIGHT_FIELD: Kind = "light field"
PICTURE: Kind = "picture"

Picture = NDArray[np.uint8]
"""`(H, W, 3)` RGB."""
Views = NDArray[np.uint8]
"""`(V, U, H, W, 3)` RGB."""


@dataclass(frozen=True, eq=False)
class Case:
    """One view of one input, made in one way."""

    input: str
    """The input's name."""
    kind: Kind
    factors: Mapping[str, str]
    """How it was made, such as `degradation` -> `box`, in the order of a label."""
    views: Views
    """The low-resolution views that a model may see: at least the window around the wanted one."""
    at: View
    """Row and column of the wanted view in `views`."""
    truth: Picture
    """The wanted view, `SCALE` times as large along each side."""
    border: int
    """Pixels that scores leave out along each edge of the truth."""
    source: Scene | LightField
    """The input that a user would reconstruct."""
    options: Options
    """The options for it, with the model `auto`."""
