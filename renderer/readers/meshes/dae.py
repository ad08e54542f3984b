"""Reads COLLADA 1.4 (.dae), parsed by pycollada, which trimesh also uses.

trimesh 5.2's own code for COLLADA is not used: it expands instances of nodes without a limit, opens textures of any
kind and size with Pillow, and ignores the axis that points up.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.readers.meshes.geometry import MAX_NODES, UPRIGHT, add_alpha, place_surfaces
from ciir.renderer.readers.meshes.polygons import triangulate
from ciir.renderer.readers.meshes.trimesh_formats import check_xml
from ciir.renderer.surface import DEFAULT_COLOR, WHITE, Surface

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.surface import Color


def read(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
    """Reads the triangles and polygons of a COLLADA file's scene, one primitive at a time, in y-up world coordinates.

    Raises `Unreadable` if the file is malformed, and `TooLarge` over `limits` or `MAX_NODES`.
    """
    import collada
    from collada.common import DaeError

    check_xml(data, name)
    document = collada.Collada(io.BytesIO(data), ignore=[DaeError])
    if document.errors:
        resolver.add_note(f"{len(document.errors):,} parts of the file are malformed or not supported and are left out")
    if document.scene is None:
        raise Unreadable(f"{name}: a COLLADA file without a scene; export it again")
    upright = UPRIGHT.get(document.assetInfo.upaxis, np.eye(4))
    placed = (
        (_surface(primitive, materials, name, resolver), matrix)
        for geometry, materials, matrix in _instances(document.scene.nodes, upright, name, resolver)
        for primitive in geometry.primitives
    )
    return place_surfaces(placed, name=name, max_triangles=limits.triangles, max_parts=MAX_NODES)


def _instances(
    nodes: list[Any], matrix: NDArray[np.float64], name: str, resolver: Resolver
) -> Iterator[tuple[Any, dict[str, Any], NDArray[np.float64]]]:
    """Yields each geometry of the scene with its materials by symbol and its world matrix."""
    from collada.scene import ControllerNode, GeometryNode, Node

    waiting = [(node, matrix) for node in reversed(nodes)]
    count = 0
    while waiting:
        node, matrix = waiting.pop()
        count += 1
        if count > MAX_NODES:
            raise TooLarge(f"{name}: over {MAX_NODES:,} nodes, which is the limit; join them")
        if isinstance(node, Node):  # an instance of a node is a Node, too
            matrix = matrix @ node.matrix
            waiting += [(child, matrix) for child in reversed(node.children)]
        elif isinstance(node, (GeometryNode, ControllerNode)):
            geometry = node.geometry if isinstance(node, GeometryNode) else getattr(node.controller, "geometry", None)
            if isinstance(node, ControllerNode):
                resolver.add_note("a skinned mesh is drawn as it was modelled, without its skeleton")
            if geometry is not None:
                yield geometry, {material.symbol: material.target for material in node.materials}, matrix


def _surface(primitive: Any, materials: dict[str, Any], name: str, resolver: Resolver) -> Surface | None:
    """Converts a primitive to triangles, each with its own three vertices; returns None if it is lines or empty."""
    from collada.polylist import Polylist
    from collada.triangleset import TriangleSet

    if isinstance(primitive, Polylist):
        if primitive.nvertices > len(primitive.index):
            raise Unreadable(f"{name}: its polygons have more corners than it lists; export it again")
        primitive = _triangulate(primitive, resolver)
    if not isinstance(primitive, TriangleSet):
        resolver.add_note("lines are left out: only polygons are drawn")
        return None
    if not len(primitive) or primitive.vertex is None:
        return None
    if primitive.index.min() < 0:
        raise Unreadable(f"{name}: an index is negative; export it again")
    vertices = primitive.vertex[primitive.vertex_index].reshape(-1, 3).astype(np.float64)
    normals = None if primitive.normal is None else primitive.normal[primitive.normal_index].reshape(-1, 3)
    uv = primitive.texcoordset[0][primitive.texcoord_indexset[0]].reshape(-1, 2) if primitive.texcoordset else None
    effect = getattr(materials.get(primitive.material), "effect", None)
    color, picture = _read_diffuse(effect)
    alpha = 1.0 if effect is None else _read_alpha(effect, resolver)
    texture = None if picture is None else resolver.load_texture(picture, opaque=True)
    if texture is not None and uv is None:
        resolver.add_note("a texture without texture coordinates is left out")
        texture = None
    colors = None if texture is not None else _vertex_colors(primitive)
    return Surface(
        vertices=vertices,
        faces=np.arange(len(vertices)).reshape(-1, 3),
        normals=None if normals is None else normals.astype(np.float64),
        color=(*(color if colors is None else WHITE)[:3], alpha),
        colors=colors,
        uv=None if texture is None or uv is None else uv.astype(np.float64),
        texture=texture,
        is_see_through=alpha < 1,
    )


def _triangulate(polygons: Any, resolver: Resolver) -> Any:
    """Converts polygons to a primitive of triangles: pycollada itself makes fans about the polygons' first corners."""
    from collada.triangleset import TriangleSet

    if polygons.vertex is None or not len(polygons.index):
        return polygons.triangleset()
    vertices, corners = polygons.vertex.astype(np.float64), np.asarray(polygons.vertex_index)
    triangles, _ = triangulate(vertices, corners, np.asarray(polygons.vcounts), resolver.add_note)
    return TriangleSet(polygons.sources, polygons.material, polygons.index[triangles].ravel(), polygons.xmlnode)


def _read_diffuse(effect: Any) -> tuple[Color, str | None]:
    """Reads the display-referred colour of an effect's diffuse light, and the name of its picture."""
    from collada.material import Map

    diffuse = getattr(effect, "diffuse", None)
    if diffuse is None:
        return DEFAULT_COLOR, None
    if isinstance(diffuse, Map):
        return WHITE, unquote(diffuse.sampler.surface.image.path)
    red, green, blue = (min(max(float(value), 0.0), 1.0) for value in diffuse[:3])
    return (red, green, blue, 1.0), None


def _read_alpha(effect: Any, resolver: Resolver) -> float:
    """Reads the opacity of an effect (COLLADA 1.4.1, "Determining Transparency"). 0 counts as 1, because exporters
    disagree on which is which.
    """
    from collada.material import OPAQUE_MODE, Map

    transparent, transparency = effect.transparent, effect.transparency
    if isinstance(transparent, Map) or isinstance(transparency, Map):
        resolver.add_note("an opacity map is left out: the material is drawn opaque")
        return 1.0
    red, green, blue, alpha = (*map(float, transparent or ()), 1.0, 1.0, 1.0, 1.0)[:4]
    if effect.opaque_mode == OPAQUE_MODE.RGB_ZERO:
        opacity = 1 - (0.212671 * red + 0.715160 * green + 0.072169 * blue) * float(transparency)
    else:
        opacity = alpha * float(transparency)
    return opacity if 0 < opacity < 1 else 1.0


def _vertex_colors(primitive: Any) -> NDArray[np.float32] | None:
    """Returns the RGBA `(n, 4)` of each corner, in [0, 1], or None if the primitive has no colours."""
    sources = primitive.sources.get("COLOR")
    if not sources:
        return None
    offset, source = sources[0][0], sources[0][4]
    values = source.data[primitive.index[:, :, offset]].reshape(-1, source.data.shape[1])
    return add_alpha(np.clip(values[:, :3], 0.0, 1.0))
