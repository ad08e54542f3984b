"""A scene as both rendering backends take it: triangles whose diffuse light is already in their vertex colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

Wrap = Literal["repeat", "mirror", "clamp"]


@dataclass(frozen=True, eq=False)
class Texture:
    """A picture on a surface, sampled bilinearly at its full resolution (no mipmaps): a sample is a point."""

    pixels: NDArray[np.uint8]
    """`(h, w, 4)` RGBA, display-referred (sRGB) 8-bit values, first row at the top."""
    wrap_u: Wrap = "repeat"
    wrap_v: Wrap = "repeat"


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one material. A point's colour is its vertex colours, interpolated, times its texture's.

    The colour does not depend on the direction it is seen from, and both sides of a triangle look alike.
    """

    vertices: NDArray[np.float64]
    """`(n, 3)`."""
    faces: NDArray[np.int32]
    """`(m, 3)` indices into `vertices`."""
    colors: NDArray[np.float32]
    """`(n, 4)` RGBA in [0, 1], display-referred: material, vertex colour and light multiplied."""
    uv: NDArray[np.float32] | None = None
    """`(n, 2)`, origin at the texture's lower left corner (OpenGL's and OBJ's convention); None without a texture."""
    texture: Texture | None = None
    alpha_cutoff: float | None = None
    """A point whose alpha is below this is not there; None where the part is opaque throughout."""

    def used_vertices(self) -> NDArray[np.float64]:
        """`(k, 3)`: the vertices that a triangle uses."""
        is_used = np.zeros(len(self.vertices), bool)  # several times quicker than np.unique
        is_used[self.faces] = True
        return np.compress(is_used, self.vertices, axis=0)  # and this than indexing


@dataclass(frozen=True, eq=False)
class Scene:
    """Parts in one right-handed coordinate system, y up."""

    parts: tuple[Part, ...]
    notes: tuple[str, ...] = ()
    """What was left out or replaced while reading, a line each, for the report."""
    extent: NDArray[np.float64] | None = None
    """What `bounds` says where triangles were taken out; None where they are all there."""

    @property
    def triangles(self) -> int:
        """Number of triangles over all parts."""
        return sum(len(part.faces) for part in self.parts)

    def bounds(self) -> NDArray[np.float64]:
        """`(2, 3)`: lowest and highest coordinates of all vertices that a triangle uses, or used before culling."""
        if self.extent is not None:
            return self.extent
        used = [part.used_vertices() for part in self.parts]
        low, high = ([[side(u[:, axis]) for axis in range(3)] for u in used] for side in (np.min, np.max))
        return np.array([np.min(low, axis=0), np.max(high, axis=0)])

    def transform(self, matrix: NDArray[np.float64]) -> Scene:
        """The scene with every vertex taken through the 4x4 affine `matrix`. Light that is baked in stays as it is, and
        of a culled scene the bounds are then those of what is left.
        """
        linear, offset = matrix[:3, :3], matrix[:3, 3]
        parts = tuple(
            Part(p.vertices @ linear.T + offset, p.faces, p.colors, p.uv, p.texture, p.alpha_cutoff) for p in self.parts
        )
        return Scene(parts, self.notes)
