"""Writes NumPy's npy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.writers.whole import WholeWriter

if TYPE_CHECKING:
    from ciir.renderer.light_field import LightField


class NpyWriter(WholeWriter):
    """Writes `L[v, u, y, x, c]` as one array."""

    name = "npy"

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the array; its header says nothing of the depth sense."""
        np.lib.format.write_array(self.file, light_field.views, allow_pickle=False)
        if light_field.depth_sense == "lenses":
            return []
        return ["npy holds no depth sense: what is written has that of cameras; npz keeps it"]
