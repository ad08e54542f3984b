"""Writes NumPy's npy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.writers.whole import WholeWriter

if TYPE_CHECKING:
    from ciir.renderer.light_field import LightField


class NpyWriter(WholeWriter):
    """Writes `L[v, u, y, x, c]`, which `numpy.load` returns, followed by the depth sense as a second array."""

    def encode(self, light_field: LightField) -> list[str]:
        """Writes both arrays."""
        for array in (light_field.views, np.array(light_field.depth_sense)):
            np.lib.format.write_array(self.file, array, allow_pickle=False)
        return []
