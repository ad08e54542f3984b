"""Writes NumPy's npy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.writers.whole import REVERSED, WholeWriter

if TYPE_CHECKING:
    from ciir.renderer.light_field import LightField


class NpyWriter(WholeWriter):
    """Writes `L[v, u, y, x, c]` as one array, with the depth sense of cameras."""

    name = "npy"

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the array, reversed where it has the depth sense of lenses, as its header can't say so."""
        np.lib.format.write_array(self.file, light_field.with_depth_sense("cameras").views, allow_pickle=False)
        return [] if light_field.depth_sense == "cameras" else [REVERSED.format(name=self.name)]
