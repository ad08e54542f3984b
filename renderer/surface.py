"""Surfaces as files contain them, and the scene that is assembled from them: checked, with normals and light."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ciir.errors import InvalidGeometry, NothingVisible, TooLarge, Unreadable
from ciir.renderer.copies import MAX_COPIED, place_copies
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.scene import Part, Scene, Texture
from ciir.renderer.shading import CREASE, LIGHT, compute_normals, cross, decode_srgb, is_solid, normalize, shade

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

MAX_COORDINATE = 1e9
"""Largest absolute coordinate, in the file's own units."""
MAX_TEXTURE_COORDINATE = 1e4
"""Largest absolute texture coordinate: beyond it float32 no longer separates neighbouring pixels."""
Back = Literal["either", "lit", "hidden"]
Color = tuple[float, float, float, float]
"""RGBA, display-referred, [0, 1]."""
WHITE: Color = (1.0, 1.0, 1.0, 1.0)
DEFAULT_COLOR: Color = (0.8, 0.8, 0.8, 1.0)
"""Colour of surfaces without one, display-referred: a light grey that shows the shading."""
_ZERO_AREA = 1e-12  # times the longest edge squared: a smaller area is a rounding error


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one material in the scene's coordinates, not yet checked or lit."""

    vertices: NDArray[np.float64]
    """`(n, 3)`."""
    faces: NDArray[np.int64]
    """`(m, 3)`."""
    normals: NDArray[np.float64] | None = None
    """`(n, 3)`, of any length; None to compute them."""
    crease: float = CREASE
    """Crease of computed normals, in degrees: as in `compute_normals`."""
    color: Color = WHITE
    colors: NDArray[np.float32] | None = None
    """Vertex colours `(n, 4)`, display-referred, [0, 1]; None for white."""
    uv: NDArray[np.float64] | None = None
    """`(n, 2)`, origin at the lower left."""
    texture: Texture | None = None
    alpha_cutoff: float | None = None
    is_see_through: bool = False
    lit: bool = True
    """False for a material that is not shaded."""
    back: Back = "either"
    """What is seen from behind, where corners run clockwise: `lit` is the same as from the front, lit with reversed
    normals, and `hidden` is nothing. `either` is `lit` with the front where given normals point, however corners
    run."""
    is_interpolated_linearly: bool = False
    """Whether colours between vertices are means of linear colours; otherwise of display-referred ones."""
    copies: NDArray[np.float64] | None = None
    """`(k, 4, 4)`: the matrix of each copy in the scene; None for one surface at its own vertices."""


def assemble_scene(
    surfaces: Sequence[Surface],
    *,
    name: str,
    notes: Sequence[str] = (),
    max_triangles: int = DEFAULT_LIMITS.triangles,
    light: NDArray[np.float64] = LIGHT,
) -> Scene:
    """Makes a scene from the surfaces of the file called `name`: checks them, computes normals and bakes the light.

    `light`: the unit direction towards the light, `(3,)`, in the surfaces' coordinates.

    Raises `InvalidGeometry` if there is no triangle, or a vertex that is not finite or beyond `MAX_COORDINATE`;
    `NothingVisible` if no triangle has a positive area; `TooLarge` over `max_triangles`; `Unreadable` if a face refers
    to a vertex that doesn't exist.
    """
    total = sum(len(surface.faces) for surface in surfaces)
    check_size(name, total, sum(len(surface.vertices) for surface in surfaces), max_triangles)
    _check_copies(surfaces, name, max_triangles)
    if total == 0:
        raise InvalidGeometry(f"{name}: no triangles; give a mesh with a surface, not points or lines alone")
    unusable: Counter[str] = Counter()
    checked = [_check_surface(surface, name, unusable) for surface in surfaces if len(surface.faces)]
    kept = [surface for surface in checked if len(surface.faces)]
    dropped = total - sum(len(surface.faces) for surface in kept)
    if not kept:
        raise NothingVisible(f"{name}: all {total:,} triangles have zero area; give a mesh with a surface")
    notes = list(notes)
    for what, count in unusable.items():
        notes.append(f"{count:,} vertices have a {what} that is NaN, infinite or too large: read as 0")
    if dropped:
        notes.append(f"{dropped:,} of {total:,} triangles have zero area and are left out")
    placed = (copy for surface in _add_normals(kept) for copy in _place_copies(surface, name))
    parts = [_bake_light(surface, light) for surface in placed]
    if not parts:
        raise NothingVisible(f"{name}: all its copies have zero area; give a mesh with a surface")
    return Scene(_join_parts(parts), tuple(notes))


def check_size(name: str, triangles: int, vertices: int, max_triangles: int) -> None:
    """Raises `TooLarge` over `max_triangles`, or over three times as many vertices, more than triangles can use."""
    if triangles > max_triangles or vertices > 3 * max_triangles:
        raise TooLarge(
            f"{name}: {triangles:,} triangles and {vertices:,} vertices; at most {max_triangles:,} and "
            f"{3 * max_triangles:,} are read; decimate the mesh",
            "triangles",
            max(triangles, -(-vertices // 3)),
        )


def _check_copies(surfaces: Sequence[Surface], name: str, max_triangles: int) -> None:
    """Raises `TooLarge` over `MAX_COPIED` times `max_triangles` in all copies, or over the usual limit of vertices."""
    counts = [1 if surface.copies is None else len(surface.copies) for surface in surfaces]
    triangles = sum(len(surface.faces) * count for surface, count in zip(surfaces, counts, strict=True))
    vertices = sum(len(surface.vertices) * count for surface, count in zip(surfaces, counts, strict=True))
    if triangles > MAX_COPIED * max_triangles or vertices > 3 * max_triangles:
        raise TooLarge(
            f"{name}: {triangles:,} triangles and {vertices:,} vertices in {sum(counts):,} copies; at most "
            f"{MAX_COPIED * max_triangles:,} and {3 * max_triangles:,} are read; decimate the mesh",
            "triangles",
        )


def _place_copies(surface: Surface, name: str) -> Iterator[Surface]:
    """Yields the surface, or its copies, checked in the same way as surfaces without copies were before."""
    if surface.copies is None:
        yield surface
        return
    _check_coordinates(surface.copies, name)
    for copy in place_copies(surface):
        _check_coordinates(copy.vertices, name)
        yield copy if copy.normals is None else replace(copy, normals=normalize(copy.normals))


def _check_coordinates(values: NDArray[np.float64], name: str) -> None:
    """Raises `InvalidGeometry` unless the values are finite and within `MAX_COORDINATE`."""
    if not np.isfinite(values).all():
        raise InvalidGeometry(f"{name}: a vertex is NaN or infinite; clean the mesh and export it again")
    largest = float(np.abs(values).max(initial=0))
    if largest > MAX_COORDINATE:
        raise InvalidGeometry(
            f"{name}: a coordinate is {largest:.3g}; at most {MAX_COORDINATE:g} is read; scale it down"
        )


def _check_surface(surface: Surface, name: str, unusable: Counter[str]) -> Surface:
    """Returns the surface without triangles of zero area and vertices that no triangle uses. Raises the errors of
    `assemble_scene`.
    """
    faces, vertices = surface.faces, surface.vertices
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise Unreadable(
            f"{name}: a face names vertex {int(faces.max() if faces.min() >= 0 else faces.min())} "
            f"but there are {len(vertices):,}; export the mesh again"
        )
    corners = vertices.take(faces, axis=0)
    _check_coordinates(corners, name)
    edges = np.roll(corners, -1, axis=1) - corners
    across = cross(edges[:, 0], edges[:, 1])  # (m, 3), towards the front, as long as twice the area
    longest = np.einsum("mci,mci->mc", edges, edges).max(axis=1)
    kept = np.linalg.norm(across, axis=1) > _ZERO_AREA * longest
    if surface.back == "either" and surface.normals is not None:
        is_reversed = np.einsum("mi,mci->m", across, surface.normals.take(faces, axis=0)) < 0
        faces = np.where(is_reversed[:, None], faces[:, ::-1], faces)
    faces = faces[kept]

    taken = _select_vertices(surface, *_find_used(faces, len(vertices)))
    return replace(
        taken,
        colors=_zero_unusable(taken.colors, "colour", unusable),
        uv=_zero_unusable(taken.uv, "texture coordinate", unusable),
    )


def _find_used(faces: NDArray[np.int64], count: int) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Returns those of `count` vertices that the faces use, and the faces with their numbers among these."""
    is_used = np.zeros(count, bool)  # several times faster than np.unique
    is_used[faces] = True
    return np.flatnonzero(is_used), (np.cumsum(is_used) - 1).take(faces)


def _zero_unusable(values: NDArray[Any] | None, what: str, unusable: Counter[str]) -> NDArray[Any] | None:
    """Returns the values of vertices with 0 for NaN and for magnitudes over `MAX_TEXTURE_COORDINATE`, counted in
    `unusable`.
    """
    if values is None:
        return None
    usable = np.abs(values) <= MAX_TEXTURE_COORDINATE  # False for NaN
    if usable.all():
        return values
    unusable[what] += int((~usable).any(axis=1).sum())
    return np.where(usable, values, 0).astype(values.dtype)


def _select_vertices(surface: Surface, index: NDArray[np.integer], faces: NDArray[np.int64]) -> Surface:
    """Returns the surface of `faces` on the vertices `index`."""
    return replace(
        surface,
        vertices=surface.vertices.take(index, axis=0),
        faces=faces,
        normals=None if surface.normals is None else surface.normals.take(index, axis=0),
        colors=None if surface.colors is None else surface.colors.take(index, axis=0),
        uv=None if surface.uv is None else surface.uv.take(index, axis=0),
    )


def _add_normals(surfaces: list[Surface]) -> list[Surface]:
    """Returns all surfaces with unit normals. Missing normals are computed over all surfaces of one crease together, so
    that there are no seams between materials, but separately for each surface that is copied.
    """
    for i, surface in enumerate(surfaces):
        if surface.normals is not None:
            normals = normalize(np.where(np.isfinite(surface.normals), surface.normals, 0.0))
            usable = bool(normals.any(axis=1).all())
            surfaces[i] = replace(surface, normals=normals if usable else None)
    bare = [i for i, surface in enumerate(surfaces) if surface.normals is None and surface.lit]
    together: dict[float, list[int]] = {}
    for i in bare:
        if surfaces[i].copies is None:
            together.setdefault(surfaces[i].crease, []).append(i)
        else:
            _compute_normals(surfaces, [i])
    for group in together.values():
        _compute_normals(surfaces, group)
    return surfaces


def _compute_normals(surfaces: list[Surface], bare: list[int]) -> None:
    """Gives the surfaces `bare` normals, computed over all of them, with the crease of the first."""
    vertex_start = np.cumsum([0] + [len(surfaces[i].vertices) for i in bare])
    face_start = np.cumsum([0] + [len(surfaces[i].faces) for i in bare])
    source, faces, normals = compute_normals(
        np.concatenate([surfaces[i].vertices for i in bare]),
        np.concatenate([surfaces[i].faces + start for i, start in zip(bare, vertex_start, strict=False)]),
        surfaces[bare[0]].crease,
    )
    first = old = int(vertex_start[-1])  # the first vertex that was split off for a surface: they are in order
    for n, i in enumerate(bare):
        own = faces[face_start[n] : face_start[n + 1]]
        vertices = np.append(np.arange(*vertex_start[n : n + 2]), np.arange(first, int(own.max()) + 1))
        count = len(surfaces[i].vertices)
        used, local = _find_used(np.where(own < old, own - vertex_start[n], own - first + count), len(vertices))
        index, first = vertices[used], first + len(vertices) - count
        surfaces[i] = replace(
            _select_vertices(surfaces[i], source[index] - vertex_start[n], local), normals=normals.take(index, axis=0)
        )


def _bake_light(surface: Surface, light: NDArray[np.float64]) -> Part:
    """Returns the surface with its material, vertex colours and light multiplied into one colour per vertex."""
    colors = np.broadcast_to(np.asarray(surface.color, np.float32), (len(surface.vertices), 4)).copy()
    if surface.colors is not None:
        colors *= surface.colors
    texture = None if surface.uv is None else surface.texture
    # Many exporters mark materials as see-through that are opaque throughout.
    is_see_through = surface.is_see_through and bool(
        colors[:, 3].min() < 1.0 or (texture is not None and texture.pixels[..., 3].min() < 255)
    )
    is_opaque = surface.alpha_cutoff is None and not is_see_through
    back_colors = None
    if surface.lit and surface.normals is not None:
        shows_back = surface.back == "lit" or (
            surface.back == "either" and not (is_opaque and is_solid(surface.vertices, surface.faces))
        )
        if shows_back:
            back_colors = np.clip(colors[:, :3] * shade(-surface.normals, light)[:, None], 0.0, 1.0)
        colors[:, :3] *= shade(surface.normals, light)[:, None]
    colors = np.clip(colors, 0.0, 1.0)
    if surface.is_interpolated_linearly:
        colors[:, :3] = decode_srgb(colors[:, :3])
        back_colors = None if back_colors is None else decode_srgb(back_colors)
    if is_opaque:
        colors[:, 3] = 1.0
    return Part(
        vertices=surface.vertices,
        faces=surface.faces.astype(np.int32),
        colors=colors,
        back_colors=back_colors,
        uv=surface.uv.astype(np.float32) if texture is not None and surface.uv is not None else None,
        texture=texture,
        alpha_cutoff=surface.alpha_cutoff,
        is_see_through=is_see_through,
        hides_back=surface.back == "hidden",
        is_linear=surface.is_interpolated_linearly,
    )


def _join_parts(parts: list[Part]) -> tuple[Part, ...]:
    """Returns one part for each texture, kind of alpha, of back and of colours; everything else is in the vertices.
    Fewer parts save the backends time.
    """
    groups: dict[tuple[Any, ...], list[Part]] = {}
    for part in parts:
        back = part.back_colors is None, part.hides_back
        key = id(part.texture), part.alpha_cutoff, part.is_see_through, back, part.is_linear
        groups.setdefault(key, []).append(part)
    return tuple(_concatenate_parts(group) for group in groups.values())


def _concatenate_parts(parts: list[Part]) -> Part:
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    uvs = [part.uv for part in parts if part.uv is not None]
    backs = [part.back_colors for part in parts if part.back_colors is not None]
    return Part(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]).astype(np.int32),
        colors=np.concatenate([part.colors for part in parts]),
        back_colors=np.concatenate(backs) if backs else None,
        uv=np.concatenate(uvs) if uvs else None,
        texture=parts[0].texture,
        alpha_cutoff=parts[0].alpha_cutoff,
        is_see_through=parts[0].is_see_through,
        hides_back=parts[0].hides_back,
        is_linear=parts[0].is_linear,
    )
