"""Reads 3MF files. trimesh parses their meshes; colours and components are read here.

trimesh 5.2 ignores colours, and loses instances of components if there are many. The format is that of the 3MF Core
Specification 1.3, in which z is up, with the colour groups of its Materials Extension.
"""

from __future__ import annotations

import io
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers.bundle import unpack
from ciir.renderer.readers.meshes.geometry import MAX_NODES, UPRIGHT, place_surfaces, split_corners
from ciir.renderer.readers.meshes.trimesh_formats import check_xml
from ciir.renderer.readers.names import clean_text
from ciir.renderer.surface import DEFAULT_COLOR, WHITE, Surface

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.surface import Color

_MODEL = "3d/3dmodel.model"
_TAGS = 8
"""The most tags for each triangle of the limit: its own and those of three vertices, opening and closing."""
_COLOR = re.compile(r"#([0-9a-fA-F]{6})([0-9a-fA-F]{2})?")
Palettes = dict[str, "list[Color]"]
References = list[tuple[str, "NDArray[np.float64]"]]
"""References to objects: the object's index and a 4x4 matrix."""


def read(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
    """Reads the objects that a 3MF builds, turned to y up, with the colours of their materials and colour groups.

    Raises `Unreadable` if the file is malformed, `UnsupportedType` if parts are in other model files, and `TooLarge`
    over `limits` or `MAX_NODES`.
    """
    from lxml import etree
    from trimesh.exchange.common import XML_PARSER_OPTIONS

    model = next((file for key, file in unpack(name, data, limits).items() if _MODEL in key.lower()), None)
    if model is None:
        raise Unreadable(f"{name}: a 3MF without {_MODEL}; export it again")
    check_xml(model, name)
    if model.count(b"<") > _TAGS * limits.triangles + 1000:
        raise TooLarge(f"{name}: more XML than {limits.triangles:,} triangles need; decimate the mesh", "triangles")
    palettes: Palettes = {}
    objects: dict[str, tuple[list[Surface], References]] = {}
    build: References = []
    tags = ("{*}basematerials", "{*}colorgroup", "{*}object", "{*}build")
    for _, element in etree.iterparse(io.BytesIO(model), tag=tags, **XML_PARSER_OPTIONS):
        kind = etree.QName(element).localname
        references = _read_references(element, objects, name)
        if kind == "build":
            build += references
        elif kind == "object":
            meshes = [_read_mesh(mesh, element, palettes, name, resolver) for mesh in element.iter("{*}mesh")]
            objects[element.get("id")] = meshes, references
        else:
            palettes[element.get("id")] = [_parse_color(entry) for entry in element.iterfind("{*}*")]
        element.clear()
    return place_surfaces(
        _instances(build, objects, name), name=name, max_triangles=limits.triangles, max_parts=MAX_NODES
    )


def _read_references(element: Any, objects: dict[str, Any], name: str) -> References:
    """Reads the components of an object, or the items of the build."""
    from trimesh.exchange.threemf import _attrib_to_transform

    references = []
    for reference in element.iter("{*}component", "{*}item"):
        index = str(reference.get("objectid"))
        if any(key.endswith("path") for key in reference.keys()):  # noqa: SIM118 - not a dict
            raise UnsupportedType(f"{name}: has parts in other model files, as slicer projects do; export one model")
        if index not in objects:
            raise Unreadable(f"{name}: object {clean_text(index)} is used before it is defined; export it again")
        references.append((index, _attrib_to_transform(reference.attrib)))
    return references


def _instances(
    build: References, objects: dict[str, tuple[list[Surface], References]], name: str
) -> Iterator[tuple[Surface, NDArray[np.float64]]]:
    """Yields the surfaces of all instances, each with its world matrix."""
    waiting = [(index, UPRIGHT["Z_UP"] @ matrix) for index, matrix in reversed(build)]
    nodes = 0
    while waiting:
        index, matrix = waiting.pop()
        nodes += 1
        if nodes > MAX_NODES:
            raise TooLarge(f"{name}: over {MAX_NODES:,} components, which is the limit; join them")
        surfaces, components = objects[index]
        yield from ((surface, matrix) for surface in surfaces)
        waiting += [(component, matrix @ own) for component, own in reversed(components)]


def _read_mesh(mesh: Any, element: Any, palettes: Palettes, name: str, resolver: Resolver) -> Surface:
    from trimesh.exchange.threemf import _read_mesh as parse_mesh

    vertices, faces = parse_mesh(mesh)
    triangles = list(mesh.iter("{*}triangle"))
    if (sum(1 for _ in mesh.iter("{*}vertex")), len(triangles)) != (len(vertices), len(faces)):
        raise Unreadable(f"{name}: a number in its mesh can't be read; export it again")
    surface = Surface(vertices, faces, color=DEFAULT_COLOR)
    group, index = element.get("pid"), element.get("pindex", "0")
    if group is None and not any("pid" in triangle.attrib for triangle in triangles):
        return surface
    colors = np.empty((len(triangles), 3, 4), np.float32)
    for number, triangle in enumerate(triangles):
        used = triangle.get("pid", group)
        palette = palettes.get(used)
        if palette is not None:
            first = triangle.get("p1", index)
            colors[number] = [palette[int(triangle.get(corner, first))] for corner in ("p1", "p2", "p3")]
        else:
            colors[number] = DEFAULT_COLOR
            if used is not None:
                resolver.add_note("3MF textures and mixed materials are left out: light grey is drawn")
    is_see_through = bool((colors[..., 3] < 1).any())
    return replace(split_corners(surface), colors=colors.reshape(-1, 4), color=WHITE, is_see_through=is_see_through)


def _parse_color(entry: Any) -> Color:
    match = _COLOR.fullmatch(entry.get("displaycolor") or entry.get("color") or "")
    if match is None:
        return DEFAULT_COLOR
    red, green, blue, alpha = bytes.fromhex(match[1] + (match[2] or "ff"))
    return red / 255, green / 255, blue / 255, (alpha or 255) / 255  # with alpha 0 nothing would be visible
