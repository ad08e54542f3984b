"""What formats share: polygons to triangles, integers to fractions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


def fans(
    polygons: Sequence[Sequence[Any] | NDArray[Any]] | NDArray[Any],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles `(m, 3)`, each polygon a fan about its first corner, and the polygon `(m,)` that each comes from.

    `polygons`: `(n, k)`, or n sequences of indices of differing lengths; those with fewer than three have no triangle.
    """
    lengths = np.array([len(polygon) for polygon in polygons], np.int64)
    triangles, sources = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    for length in np.unique(lengths[lengths >= 3]):
        members = np.flatnonzero(lengths == length)
        alike = np.array([polygons[int(i)] for i in members]) if len(members) < len(lengths) else np.array(polygons)
        fan = np.stack([alike[:, [0, i, i + 1]] for i in range(1, int(length) - 1)], axis=1)
        triangles.append(fan.reshape(-1, 3).astype(np.int64))
        sources.append(np.repeat(members, int(length) - 2))
    order = np.argsort(source := np.concatenate(sources), kind="stable")
    return np.concatenate(triangles)[order], source[order]


def normalised(values: NDArray[Any]) -> NDArray[Any]:
    """Integers that stand for [0, 1], or for [-1, 1] where they are signed, as float32; floats as they are.

    As in glTF 2.0, section 3.6.2.2: over the most that the type holds, and never below -1.
    """
    if values.dtype.kind == "f":
        return values
    scaled: NDArray[Any] = np.maximum(values.astype(np.float32) / np.iinfo(values.dtype).max, np.float32(-1.0))
    return scaled
