"""Writes a whole light field, in the format that the name asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.pictures import BY_SUFFIX, encode
from ciir.renderer.writers.views import save_views

if TYPE_CHECKING:
    from pathlib import Path

    from ciir.renderer.readers.pictures import Pixels


def save_light_field(views: Pixels, path: Path) -> None:
    """Writes `views`, `(V, U, H, W, C)`: as an elemental image array into a picture, else view by view.

    Raises `InvalidOption` where `path` can't be written or the format can't hold the pixels.
    """
    suffix = path.suffix.lower()
    if suffix in BY_SUFFIX:
        v, u, rows, cols, channels = views.shape
        eia = views.transpose(2, 0, 3, 1, 4).reshape(rows * v, cols * u, channels)
        with replacing(path) as file:
            file.write(encode(eia, suffix))
    else:
        save_views({index: views[index] for index in np.ndindex(views.shape[0], views.shape[1])}, {}, path)
