"""PLY, ASCII and binary, to a surface (Turk, "The PLY Polygon File Format", 1994).

Read by this project's own code and not by trimesh 5.2, which refuses binary faces of mixed lengths or reads them as
garbage where the total fits, passes over short rows, and casts 16-bit colours modulo 256, each without a word. A reader
on top of it that vets all this was written and measured: nearly as long, slower, and still without mixed faces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.readers.meshes.polygons import fans, normalised, numbers
from ciir.renderer.readers.names import clean_text
from ciir.renderer.surface import DEFAULT_COLOR, Surface, check_size

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.scene import Texture

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class _Property:
    name: str
    dtype: str
    length: str | None = None
    """For a list: the type of the count that stands before its items."""


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]


def read(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
    """The faces of a PLY as one surface, with its normals, and its colours (display-referred) or texture.

    Raises `Unreadable` or `TooLarge`, or `ValueError` and its like where a number isn't one.
    """
    head, end, body = data.partition(b"end_header")
    if not end:
        raise Unreadable(f"{name}: a PLY whose header does not end; give it again")
    elements, order, picture = _header(head.decode("latin-1"), name, limits.triangles)
    body = body[2:] if body.startswith(b"\r\n") else body[1:]
    columns = _ascii(body, elements, name) if order == "=" else _binary(body, elements, order, name)
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    indices = face.get("vertex_indices", face.get("vertex_index"))
    if indices is None or not {"x", "y", "z"} <= vertex.keys():
        return []
    vertices = _stacked(vertex, ("x", "y", "z"))
    if isinstance(indices, np.ndarray) and len(indices):
        lengths, corners = np.full(len(indices), indices.shape[1]), indices.ravel()
    else:
        lengths, corners = np.array([len(row) for row in indices], np.int64), np.concatenate([np.empty(0), *indices])
    check_size(name, int(np.maximum(lengths - 2, 0).sum()), len(vertices), limits.triangles)
    triangles, face_of = fans(lengths)
    surface = Surface(
        vertices=vertices.astype(np.float64),
        faces=corners.astype(np.int64)[triangles],
        normals=_stacked(vertex, ("nx", "ny", "nz")).astype(np.float64)
        if {"nx", "ny", "nz"} <= vertex.keys()
        else None,
        color=DEFAULT_COLOR,
    )
    texture = None if picture is None else resolver.texture(picture, opaque=True)
    colored = _colored(surface, vertex, face, face_of, texture)
    if texture is not None and colored.uv is None:
        resolver.note("a texture without texture coordinates is left out")
    return [colored]


def _header(head: str, name: str, max_triangles: int) -> tuple[list[_Element], str, str | None]:
    elements: list[_Element] = []
    order, picture = None, None
    for line in head.splitlines()[1:]:
        match line.split():
            case ["format", form, *_] if form in _ORDERS:
                order = _ORDERS[form]
            case ["comment", "TextureFile", *_]:
                picture = line.split("TextureFile", 1)[1].strip()
            case ["element", kind, count] if 0 <= int(count) <= 3 * max_triangles:
                elements.append(_Element(kind, int(count), []))
            case ["element", kind, count]:
                if int(count) < 0:
                    raise Unreadable(
                        f"{name}: its PLY header counts {clean_text(count)} of {clean_text(kind)}; export it again"
                    )
                raise TooLarge(
                    f"{name}: {clean_text(f'{int(count):,}')} elements {clean_text(kind)}; "
                    f"at most {3 * max_triangles:,} are read, and {max_triangles:,} triangles; decimate the mesh"
                )
            case ["property", "list", length, dtype, item] if elements:
                elements[-1].properties.append(_Property(item, _TYPES[dtype], _TYPES[length]))
            case ["property", dtype, item] if elements:
                elements[-1].properties.append(_Property(item, _TYPES[dtype]))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise Unreadable(f"{name}: a line of its PLY header can't be read; export it again")
    if order is None:
        raise Unreadable(f"{name}: its PLY header names no format; export it again")
    return elements, order, picture


def _binary(body: bytes, elements: list[_Element], order: str, name: str) -> dict[str, dict[str, Any]]:
    columns, start = {}, 0
    for element in elements:
        columns[element.name], start = _binary_element(body, start, element, order, name)
    return columns


def _binary_element(body: bytes, start: int, element: _Element, order: str, name: str) -> tuple[dict[str, Any], int]:
    """All rows at once where every list is as long as in the first row, which is nearly always; else row by row."""
    if element.count == 0:
        return {item.name: np.empty(0) for item in element.properties}, start
    fields: list[Any] = []
    at = start
    for number, item in enumerate(element.properties):
        dtype = np.dtype(order + item.dtype)
        if item.length is None:
            fields.append((f"{number}", dtype))
            at += dtype.itemsize
        else:
            length = np.dtype(order + item.length)
            count = int(np.frombuffer(body, length, 1, at)[0])
            fields += [(f"count {number}", length), (f"{number}", dtype, (max(count, 0),))]
            at += length.itemsize + dtype.itemsize * max(count, 0)
    row = np.dtype(fields)
    whole = start + row.itemsize * element.count <= len(body)
    if whole:
        rows = np.frombuffer(body, row, element.count, start)
        counts = [rows[f"count {n}"] for n, item in enumerate(element.properties) if item.length is not None]
        if all((count == count[0]).all() for count in counts):
            return {item.name: rows[f"{n}"] for n, item in enumerate(element.properties)}, start + rows.nbytes
    elif all(item.length is None for item in element.properties):
        raise Unreadable(f"{name}: its PLY data is cut short; give it again")
    ragged: dict[str, list[Any]] = {item.name: [] for item in element.properties}
    for _ in range(element.count):
        for item in element.properties:
            count = 1
            if item.length is not None:
                length = np.dtype(order + item.length)
                count = int(np.frombuffer(body, length, 1, start)[0])
                start += length.itemsize
            dtype = np.dtype(order + item.dtype)
            if count < 0 or start + count * dtype.itemsize > len(body):
                raise Unreadable(f"{name}: its PLY data is cut short; give it again")
            values = np.frombuffer(body, dtype, count, start)
            start += values.nbytes
            ragged[item.name].append(values if item.length is not None else values[0])
    return {item.name: _column(ragged[item.name], item) for item in element.properties}, start


def _ascii(body: bytes, elements: list[_Element], name: str) -> dict[str, dict[str, Any]]:
    found = numbers(body.split())
    columns: dict[str, dict[str, Any]] = {}
    start = 0
    for element in elements:
        width = len(element.properties)
        if all(item.length is None for item in element.properties):
            if start + width * element.count > len(found):
                raise Unreadable(f"{name}: its PLY data is cut short; give it again")
            table = found[start : start + width * element.count].reshape(element.count, width)
            columns[element.name] = {
                item.name: table[:, n].astype(item.dtype) for n, item in enumerate(element.properties)
            }
            start += table.size
            continue
        ragged: dict[str, list[Any]] = {item.name: [] for item in element.properties}
        for _ in range(element.count):
            for item in element.properties:
                count = 1
                if item.length is not None:
                    count = int(found[start])
                    start += 1
                if count < 0 or start + count > len(found):
                    raise Unreadable(f"{name}: its PLY data is cut short; give it again")
                values = found[start : start + count]
                start += count
                ragged[item.name].append(values if item.length is not None else values[0])
        columns[element.name] = {item.name: _column(ragged[item.name], item) for item in element.properties}
    return columns


def _column(values: list[Any], item: _Property) -> Any:  # an array, or a list of arrays where they differ
    if item.length is not None and len({len(value) for value in values}) > 1:
        return values
    return np.array(values).astype(item.dtype)


def _stacked(columns: dict[str, Any], names: tuple[str, ...]) -> NDArray[Any]:
    return np.stack([columns[name] for name in names], axis=1)


def _colored(
    surface: Surface,
    vertex: dict[str, Any],
    face: dict[str, Any],
    face_of: NDArray[np.int64],
    texture: Texture | None,
) -> Surface:
    """The surface with what it has of texture, vertex colours and face colours: the first of them that is there."""
    white = (1.0, 1.0, 1.0, 1.0)
    if texture is not None and "texcoord" in face:
        corners = _split(surface)
        uv = np.array(face["texcoord"], np.float64)
        if uv.shape == (len(surface.faces), 6):  # u and v of three corners: triangles alone have them so
            return replace(corners, uv=uv.reshape(-1, 2), texture=texture, color=white)
    if texture is not None:
        for pair in (("s", "t"), ("u", "v"), ("texture_u", "texture_v")):
            if set(pair) <= vertex.keys():
                return replace(surface, uv=_stacked(vertex, pair).astype(np.float64), texture=texture, color=white)
    for prefix in ("", "diffuse_"):
        names = (f"{prefix}red", f"{prefix}green", f"{prefix}blue")
        if set(names) <= vertex.keys():
            return replace(surface, colors=_rgba(vertex, names), color=white)
        if set(names) <= face.keys():
            return replace(_split(surface), colors=_rgba(face, names)[np.repeat(face_of, 3)], color=white)
    return surface


def _rgba(columns: dict[str, Any], names: tuple[str, ...]) -> NDArray[np.float32]:
    """Colours `(n, 4)` in [0, 1]: floats as they are, integers over the most that their type holds."""
    rgba = np.ones((len(columns[names[0]]), 4), np.float32)
    rgba[:, :3] = normalised(_stacked(columns, names))
    return rgba


def _split(surface: Surface) -> Surface:
    """Three vertices of its own for each triangle."""
    index = surface.faces.ravel()
    if len(index) and not 0 <= index.min() <= index.max() < len(surface.vertices):
        raise IndexError("a face names a vertex that is not there")
    return replace(
        surface,
        vertices=surface.vertices[index],
        faces=np.arange(len(index)).reshape(-1, 3),
        normals=None if surface.normals is None else surface.normals[index],
    )
