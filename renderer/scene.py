"""A scene for the rendering backends: triangles with diffuse light baked into their vertex colours."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

Wrap = Literal["repeat", "mirror", "clamp"]
SOLID = 0.5
"""Alpha from which on a see-through point counts as solid where it can't be blended: in OpenGL and the depth
channel."""


@dataclass(frozen=True, eq=False)
class Texture:
    """A picture on a surface, sampled at its full resolution (no mipmaps)."""

    pixels: NDArray[np.uint8]
    """`(h, w, 4)` RGBA, display-referred (sRGB) 8-bit values, first row at the top."""
    wrap_u: Wrap = "repeat"
    wrap_v: Wrap = "repeat"
    is_nearest: bool = False
    """Whether a point has the colour of the nearest texel, as in pixel art; otherwise the texels around it are
    interpolated."""


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one material. A point's colour is the interpolated vertex colour times the texture."""

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
    """Points with alpha below this are cut out; None for a part without cut-outs."""
    is_see_through: bool = False
    """Whether alpha is the share of what lies behind a point that it hides; it is blended in display-referred
    values."""
    back_colors: NDArray[np.float32] | None = None
    """`(n, 3)` RGB of the back, from which corners run clockwise; None if both sides look the same."""
    hides_back: bool = False
    """Whether the back is missing, so that what lies behind it is seen."""
    is_linear: bool = False
    """Whether RGB is linear, so that it is interpolated as light; it is encoded before the texture is multiplied."""

    def used_vertices(self) -> NDArray[np.float64]:
        """Returns the vertices that a triangle uses, `(k, 3)`."""
        is_used = np.zeros(len(self.vertices), bool)  # several times faster than np.unique
        is_used[self.faces] = True
        return np.compress(is_used, self.vertices, axis=0)  # faster than indexing


@dataclass(frozen=True)
class Window:
    """What a camera in the file sees, in the scene's coordinates: the camera is at the origin and looks along -z."""

    nearest: float
    """Distance along -z, like the others."""
    distance: float
    """Distance of the subject: half of the picture shows what is nearer."""
    farthest: float
    half_height: float
    """Half the height of the picture at the subject's distance."""
    half_width: float | None
    """None if the camera leaves it to the view's shape."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Parts in one right-handed coordinate system, y up."""

    parts: tuple[Part, ...]
    notes: tuple[str, ...] = ()
    """Notes on what reading left out or replaced, one line each, for the report."""
    extent: NDArray[np.float64] | None = None
    """The bounds before culling; None for a scene that was not culled."""
    framed: Scene | None = None
    """What is framed in its place: for an animation or a turn, the extremes of all frames; None for the scene
    itself."""
    window: Window | None = None
    """The part of it that is framed; None for all."""

    @property
    def triangles(self) -> int:
        """Number of triangles over all parts."""
        return sum(len(part.faces) for part in self.parts)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays, textures included."""
        arrays = [
            array
            for part in self.parts
            for array in (part.vertices, part.faces, part.colors, part.uv, part.back_colors)
            if array is not None
        ]
        textures = {id(part.texture): part.texture.pixels for part in self.parts if part.texture is not None}
        return sum(array.nbytes for array in (*arrays, *textures.values()))

    @property
    def is_see_through(self) -> bool:
        """Whether some part is see-through."""
        return any(part.is_see_through for part in self.parts)

    @property
    def hides_backs(self) -> bool:
        """Whether some part hides its back."""
        return any(part.hides_back for part in self.parts)

    def bounds(self) -> NDArray[np.float64]:
        """Returns the lowest and highest coordinates, `(2, 3)`, of all vertices that a triangle uses, or used before
        culling.
        """
        if self.extent is not None:
            return self.extent
        used = [part.used_vertices() for part in self.parts]
        low, high = ([[side(u[:, axis]) for axis in range(3)] for u in used] for side in (np.min, np.max))
        return np.array([np.min(low, axis=0), np.max(high, axis=0)])

    def transform(self, matrix: NDArray[np.float64]) -> Scene:
        """Returns the scene with all vertices transformed by the 4x4 affine `matrix`, without `extent`; baked light
        stays.
        """
        linear, offset = matrix[:3, :3], matrix[:3, 3]
        parts = tuple(replace(part, vertices=part.vertices @ linear.T + offset) for part in self.parts)
        return Scene(parts, self.notes)
