"""A surface as a file gives it, and the checks and the light that make it a part of a scene."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidGeometry, TooLarge, Unreadable
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.scene import Part, Scene, Texture
from ciir.renderer.shading import compute_normals, normalize, shade

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

MAX_COORDINATE = 1e9
"""Largest absolute coordinate, in the file's own units: beyond it nothing is a picture of an object."""
MAX_TEXTURE_COORDINATE = 1e4
"""Largest absolute texture coordinate: beyond it float32 no longer tells a pixel from its neighbour."""
DEFAULT_COLOR = (0.8, 0.8, 0.8, 1.0)
"""What has no colour at all, display-referred: a light grey on which the light can be seen."""
_FLAT = 1e-12  # of the longest edge squared: below it a triangle's area is rounding


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one material in the scene's coordinates, before light. Nothing about it has been checked."""

    vertices: NDArray[np.float64]
    """`(n, 3)`."""
    faces: NDArray[np.int64]
    """`(m, 3)`."""
    normals: NDArray[np.float64] | None = None
    """`(n, 3)`, of any length; None where they must be computed."""
    color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """The material's RGBA, display-referred, [0, 1]."""
    colors: NDArray[np.float32] | None = None
    """Vertex colours `(n, 4)`, display-referred, [0, 1]; None for white."""
    uv: NDArray[np.float64] | None = None
    """`(n, 2)`, origin at the lower left."""
    texture: Texture | None = None
    alpha_cutoff: float | None = None
    lit: bool = True
    """False for a material that is drawn without light."""


def assemble_scene(
    surfaces: Sequence[Surface], *, name: str, notes: Sequence[str] = (), max_triangles: int = DEFAULT_LIMITS.triangles
) -> Scene:
    """Check the surfaces of the file called `name`, give them normals and light, and make a scene of them.

    Raises `InvalidGeometry` without one triangle of positive area, or with a vertex that is not finite or beyond
    `MAX_COORDINATE`; `TooLarge` over `max_triangles`; `Unreadable` where a face names a vertex that isn't there.
    """
    total = sum(len(surface.faces) for surface in surfaces)
    check_size(name, total, sum(len(surface.vertices) for surface in surfaces), max_triangles)
    if total == 0:
        raise InvalidGeometry(f"{name}: no triangles; give a mesh with a surface, not points or lines alone")
    unusable: Counter[str] = Counter()
    checked = [_checked(surface, name, unusable) for surface in surfaces if len(surface.faces)]
    kept = [surface for surface in checked if len(surface.faces)]
    dropped = total - sum(len(surface.faces) for surface in kept)
    if not kept:
        raise InvalidGeometry(f"{name}: all {total:,} triangles have zero area; give a mesh with a surface")
    notes = list(notes)
    for what, count in unusable.items():
        notes.append(f"{count:,} vertices have a {what} that is no usable number: taken as 0")
    if dropped:
        notes.append(f"{dropped:,} of {total:,} triangles have zero area and are left out")
    return Scene(_joined([_lit(surface) for surface in _with_normals(kept)]), tuple(notes))


def check_size(name: str, triangles: int, vertices: int, max_triangles: int) -> None:
    """Raises `TooLarge` over `max_triangles`, or over three times as many vertices: more than triangles can use."""
    if triangles > max_triangles or vertices > 3 * max_triangles:
        raise TooLarge(
            f"{name}: {triangles:,} triangles and {vertices:,} vertices; at most {max_triangles:,} and "
            f"{3 * max_triangles:,} are read; decimate the mesh"
        )


def _checked(surface: Surface, name: str, unusable: Counter[str]) -> Surface:
    """The surface without triangles of zero area and without vertices that none uses."""
    faces, vertices = surface.faces, surface.vertices
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise Unreadable(
            f"{name}: a face names vertex {int(faces.max() if faces.min() >= 0 else faces.min())} "
            f"but there are {len(vertices):,}; export the mesh again"
        )
    corners = vertices[faces]
    if not np.isfinite(corners).all():
        raise InvalidGeometry(f"{name}: a vertex is NaN or infinite; clean the mesh and export it again")
    largest = float(np.abs(corners).max())
    if largest > MAX_COORDINATE:
        raise InvalidGeometry(
            f"{name}: a coordinate is {largest:.3g}; at most {MAX_COORDINATE:g} is read; scale it down"
        )
    edges = np.roll(corners, -1, axis=1) - corners
    doubled_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    longest = np.einsum("mci,mci->mc", edges, edges).max(axis=1)
    faces = faces[doubled_area > _FLAT * longest]

    used = np.zeros(len(vertices), bool)
    used[faces] = True
    renumbered = np.cumsum(used) - 1
    taken = _taking(surface, np.flatnonzero(used), renumbered[faces])
    return replace(
        taken, colors=_sane(taken.colors, "colour", unusable), uv=_sane(taken.uv, "texture coordinate", unusable)
    )


def _sane(values: NDArray[Any] | None, what: str, unusable: Counter[str]) -> NDArray[Any] | None:
    """Values of vertices with 0 for those from which no picture can be made, which are counted."""
    if values is None:
        return None
    usable = np.abs(values) <= MAX_TEXTURE_COORDINATE  # False for NaN
    if usable.all():
        return values
    unusable[what] += int((~usable).any(axis=1).sum())
    return np.where(usable, values, 0).astype(values.dtype)


def _taking(surface: Surface, index: NDArray[np.integer], faces: NDArray[np.int64]) -> Surface:
    """The surface on the vertices `index` of its own."""
    return replace(
        surface,
        vertices=surface.vertices[index],
        faces=faces,
        normals=None if surface.normals is None else surface.normals[index],
        colors=None if surface.colors is None else surface.colors[index],
        uv=None if surface.uv is None else surface.uv[index],
    )


def _with_normals(surfaces: list[Surface]) -> list[Surface]:
    """All surfaces with unit normals. Those without any are one mesh here: no seams in the light between materials."""
    for i, surface in enumerate(surfaces):
        if surface.normals is not None:
            normals = normalize(np.where(np.isfinite(surface.normals), surface.normals, 0.0))
            usable = bool(normals.any(axis=1).all())
            surfaces[i] = replace(surface, normals=normals if usable else None)
    bare = [i for i, surface in enumerate(surfaces) if surface.normals is None and surface.lit]
    if not bare:
        return surfaces
    vertex_start = np.cumsum([0] + [len(surfaces[i].vertices) for i in bare])
    face_start = np.cumsum([0] + [len(surfaces[i].faces) for i in bare])
    source, faces, normals = compute_normals(
        np.concatenate([surfaces[i].vertices for i in bare]),
        np.concatenate([surfaces[i].faces + start for i, start in zip(bare, vertex_start, strict=False)]),
    )
    for n, i in enumerate(bare):
        own = faces[face_start[n] : face_start[n + 1]]
        index, local = np.unique(own, return_inverse=True)
        taken = _taking(surfaces[i], source[index] - vertex_start[n], local.reshape(-1, 3))
        surfaces[i] = replace(taken, normals=normals[index])
    return surfaces


def _lit(surface: Surface) -> Part:
    colors = np.broadcast_to(np.asarray(surface.color, np.float32), (len(surface.vertices), 4)).copy()
    if surface.colors is not None:
        colors *= surface.colors
    if surface.lit and surface.normals is not None:
        colors[:, :3] *= shade(surface.normals)[:, None]
    if surface.alpha_cutoff is None:
        colors[:, 3] = 1.0
    textured = surface.texture is not None and surface.uv is not None
    return Part(
        vertices=surface.vertices,
        faces=surface.faces.astype(np.int32),
        colors=np.clip(colors, 0.0, 1.0),
        uv=surface.uv.astype(np.float32) if textured and surface.uv is not None else None,
        texture=surface.texture if textured else None,
        alpha_cutoff=surface.alpha_cutoff,
    )


def _joined(parts: list[Part]) -> tuple[Part, ...]:
    """One part for each texture and cutoff: everything else is in the vertices, and a backend pays for each part."""
    groups: dict[tuple[int, float | None], list[Part]] = {}
    for part in parts:
        groups.setdefault((id(part.texture), part.alpha_cutoff), []).append(part)
    return tuple(_concatenated(group) for group in groups.values())


def _concatenated(parts: list[Part]) -> Part:
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    uvs = [part.uv for part in parts if part.uv is not None]
    return Part(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]).astype(np.int32),
        colors=np.concatenate([part.colors for part in parts]),
        uv=np.concatenate(uvs) if uvs else None,
        texture=parts[0].texture,
        alpha_cutoff=parts[0].alpha_cutoff,
    )
