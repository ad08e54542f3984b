"""Reads ASCII and binary PLY, parsed by trimesh, and corrects what trimesh 5.2 gets wrong without an error.

trimesh casts 16-bit colours modulo 256, reads binary faces of different lengths as if they had the same length, and
accepts files that are cut short. The format is described in Turk, "The PLY Polygon File Format", 1994. A header line
`comment unlit` is our own (`renderer.focus.model.files`): the colours already contain the light of the captured scene.
"""

from __future__ import annotations

import io
from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers.meshes.geometry import add_alpha, normalise, scale_levels, split_corners
from ciir.renderer.readers.meshes.polygons import triangulate
from ciir.renderer.readers.names import clean_text
from ciir.renderer.surface import DEFAULT_COLOR, WHITE, Surface, check_size

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.scene import Texture

UNLIT = "comment unlit"
"""The header line of files whose colours must not be lit."""
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_ALPHAS = ("alpha", "a")
_FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")


def read(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
    """Reads the faces of a PLY as one surface, or as one for each of several textures, with normals and with
    display-referred colours or a texture.

    Raises `Unreadable` if the file is cut short or malformed, `UnsupportedType` for triangle strips, or `TooLarge` over
    `limits`.
    """
    # These are the parsers that load_ply uses; load_ply itself also reads textures, colours and edges.
    from trimesh.exchange.ply import _parse_header

    file = io.BytesIO(_with_plain_header(data, name))
    elements, is_ascii, _ = _parse_header(file)
    header = file.getvalue()[: file.tell()].splitlines()
    if "tristrips" in elements and "face" not in elements:
        raise UnsupportedType(f"{name}: a PLY of triangle strips (tristrips), which are not read; export it with faces")
    for kind, element in elements.items():
        _check_count(name, kind, element["length"], limits.triangles)
    (_parse_ascii if is_ascii else _parse_binary)(elements, file, name)
    vertex, face = (elements.get(kind, {"properties": {}}) for kind in ("vertex", "face"))
    key = next((key for key in ("vertex_indices", "vertex_index") if key in face["properties"]), None)
    if key is None or not face["length"] or not vertex["length"]:
        return []
    lengths, corners = _flatten(_column(face, key))
    check_size(name, int(np.maximum(lengths - 2, 0).sum()), vertex["length"], limits.triangles)
    vertices, corners = _stack(vertex, "x", "y", "z").astype(np.float64), corners.astype(np.int64)
    triangles, face_of = triangulate(vertices, corners, lengths, resolver.add_note)
    surface = Surface(
        vertices=vertices,
        faces=corners[triangles],
        normals=_stack(vertex, "nx", "ny", "nz").astype(np.float64) if "nx" in vertex["properties"] else None,
        color=DEFAULT_COLOR,
        lit=UNLIT.encode() not in header,
    )
    comments = (line.decode().split(None, 2) for line in header)
    pictures = [words[2].strip() for words in comments if len(words) == 3 and words[1].lower() == "texturefile"]
    textures, texture_of = _load_textures(pictures, face, face_of, resolver)
    plain = mapped = _add_colors(surface, vertex, face, face_of, resolver)
    if any(textures):
        mapped = _add_coordinates(surface, vertex, face, resolver, lengths=lengths, triangles=triangles) or plain
    if mapped is plain:
        return [plain]
    wholes = [plain if texture is None else replace(mapped, texture=texture) for texture in textures]
    if len(wholes) == 1:
        return wholes
    own = np.split(np.argsort(texture_of, kind="stable"), np.cumsum(np.bincount(texture_of))[:-1])
    return [_take(whole, chosen) for whole, chosen in zip(wholes, own, strict=True)]


def _load_textures(
    pictures: list[str], face: dict[str, Any], face_of: NDArray[np.int64], resolver: Resolver
) -> tuple[list[Texture | None], NDArray[np.int64]]:
    """Loads the textures, each once; None is for faces without one. Also returns each triangle's index in that list."""
    number = np.zeros(len(face_of), np.int64)
    if len(pictures) > 1:
        if "texnumber" in face["properties"]:
            number = _stack(face, "texnumber")[face_of, 0].astype(np.int64)
        else:
            resolver.add_note(
                f"{clean_text(pictures[0])} is used for all faces, as none names one of {len(pictures)} textures"
            )
    textures: dict[Texture | None, int] = {}
    numbers, index = np.unique(number, return_inverse=True)
    places = []
    for each in numbers.tolist():
        is_one = 0 <= each < len(pictures)
        texture = resolver.load_texture(pictures[each], opaque=True) if is_one else None
        places.append(textures.setdefault(texture, len(textures)))
        if each > 0 and not is_one:
            resolver.add_note("faces whose texture the header doesn't name are drawn without one")
    return list(textures), np.array(places, np.int64)[index]


def _take(surface: Surface, chosen: NDArray[np.intp]) -> Surface:
    """Returns the surface of the faces that are `chosen`."""
    index, local = np.unique(surface.faces[chosen], return_inverse=True)
    if index[0] < 0:
        raise IndexError("a face names a vertex that is not there")
    return replace(
        surface,
        vertices=surface.vertices[index],
        faces=local.reshape(-1, 3),
        normals=None if surface.normals is None else surface.normals[index],
        colors=None if surface.colors is None else surface.colors[index],
        uv=None if surface.uv is None else surface.uv[index],
    )


def _with_plain_header(data: bytes, name: str) -> bytes:
    """Returns the PLY with its format in line 2, where trimesh expects it, and with line feeds in the header."""
    head, end, body = data.partition(b"end_header")
    if not end:
        raise Unreadable(f"{name}: a PLY whose header does not end; give it again")
    first, *lines = (line for line in head.decode(errors="replace").splitlines() if line.strip())
    form = next((line for line in lines if line.split()[0] == "format"), "")
    if form.split()[1:2] not in [[known] for known in _FORMATS]:
        raise Unreadable(f"{name}: its PLY header names no known format; export it again")
    lines.remove(form)
    body = body[2:] if body.startswith(b"\r\n") else body[1:]
    return "\n".join([first, form, *lines, "end_header\n"]).encode() + body


def _check_count(name: str, kind: str, count: int, max_triangles: int) -> None:
    if count < 0:
        raise Unreadable(f"{name}: its PLY header counts {count} of {clean_text(kind)}; export it again")
    if count > 3 * max_triangles:
        raise TooLarge(
            f"{name}: {clean_text(f'{count:,}')} elements {clean_text(kind)}; at most {3 * max_triangles:,} are read, "
            f"and {max_triangles:,} triangles; decimate the mesh",
            "triangles",
        )


def _parse_ascii(elements: dict[str, Any], file: io.BytesIO, name: str) -> None:
    """Fills in the columns of `elements`, and checks that each row has the numbers that header and lists require."""
    from trimesh.exchange.ply import _ply_ascii

    lines = file.getvalue()[file.tell() :].decode().splitlines()
    _ply_ascii(elements, file)
    start = 0
    for element in elements.values():
        rows = lines[start : start + element["length"]]
        start += element["length"]
        lists = ["$LIST" in kind for kind in element["properties"].values()]
        columns = element.get("data", {}).values()
        found = sum(sum(map(len, column)) if column.dtype == object else column.size for column in columns)
        expected = 0
        for row in rows:
            words, at = row.split(), 0
            for is_list in lists:
                at += 1 + int(words[at]) if is_list else 1
            expected += at - sum(lists)
        if len(rows) < element["length"] or found != expected:
            raise Unreadable(f"{name}: its PLY data is cut short or has rows of the wrong length; give it again")


def _parse_binary(elements: dict[str, Any], file: io.BytesIO, name: str) -> None:
    """Fills in the columns of `elements`: by trimesh if each property's lists have one length, else row by row."""
    from trimesh.exchange.ply import _ply_binary

    described = deepcopy(elements)  # trimesh replaces lengths of lists, and removes elements beyond the end of the file
    start = file.tell()
    try:
        _ply_binary(elements, file)
        columns = [elements[kind]["data"][key] for kind, element in described.items() for key in element["properties"]]
        if all((column["f0"] == column["f0"][0]).all() for column in columns if column.dtype.names and len(column)):
            return
    except (KeyError, TypeError, ValueError):  # the file doesn't have the length that its first rows imply
        pass
    body = file.getvalue()
    for element in described.values():
        element["data"], start = _parse_rows(body, start, element["properties"], element["length"], name)
    elements.update(described)


def _parse_rows(
    body: bytes, start: int, types: dict[str, str], count: int, name: str
) -> tuple[dict[str, Any] | NDArray[Any], int]:
    """Parses `count` rows of a binary PLY from `start` on. Also returns where they end."""
    parts = {key: [np.dtype(part) for part in kind.split(", ($LIST,)")] for key, kind in types.items()}
    if all(len(part) == 1 for part in parts.values()):
        row = np.dtype([(key, part[0]) for key, part in parts.items()])
        if start + count * row.itemsize > len(body):
            raise Unreadable(f"{name}: its PLY data is cut short; give it again")
        return np.frombuffer(body, row, count, start), start + count * row.itemsize
    columns: dict[str, list[NDArray[Any]]] = {key: [] for key in types}
    for _ in range(count):
        for key, (*length_type, item) in parts.items():
            length = 1
            if length_type:
                length = int(np.frombuffer(body, length_type[0], 1, start)[0])
                start += length_type[0].itemsize
            if length < 0 or start + length * item.itemsize > len(body):
                raise Unreadable(f"{name}: its PLY data is cut short; give it again")
            columns[key].append(np.frombuffer(body, item, length, start))
            start += length * item.itemsize
    return columns, start


def _column(element: dict[str, Any], key: str) -> Any:
    """Returns a property as `(rows, values)`, or as one array for each row if its lists differ in length."""
    column = element["data"][key]
    if isinstance(column, list) or column.dtype == object:
        return column
    return (column["f1"] if column.dtype.names else column).reshape(element["length"], -1)


def _stack(element: dict[str, Any], *keys: str) -> NDArray[Any]:
    """Stacks properties that are not lists into an array `(rows, keys)`."""
    return np.concatenate([np.asarray(_column(element, key)) for key in keys], axis=1)


def _flatten(column: Any) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Returns the length of each list of a column, and all values one after another."""
    if isinstance(column, np.ndarray) and column.dtype != object:
        return np.full(len(column), column.shape[1]), column.ravel()
    return np.fromiter(map(len, column), np.int64, len(column)), np.concatenate(column)


def _add_coordinates(
    surface: Surface,
    vertex: dict[str, Any],
    face: dict[str, Any],
    resolver: Resolver,
    *,
    lengths: NDArray[np.int64],
    triangles: NDArray[np.int64],
) -> Surface | None:
    """Returns the surface with the texture coordinates of its faces' corners, or else of its vertices. Returns None and
    adds a note if there are none.

    `lengths` and `triangles` are as in `polygons.triangulate`.
    """
    if "texcoord" in face["properties"]:
        counts, uv = _flatten(_column(face, "texcoord"))
        if (counts == 2 * lengths).all():
            of_corners = uv.astype(np.float64).reshape(-1, 2)[triangles.ravel()]
            return replace(split_corners(surface), uv=of_corners, color=WHITE)
        resolver.add_note(
            "texture coordinates of faces are left out: there must be two for each corner; export it again"
        )
    for pair in (("s", "t"), ("u", "v"), ("texture_u", "texture_v")):
        if set(pair) <= vertex["properties"].keys():
            return replace(surface, uv=_stack(vertex, *pair).astype(np.float64), color=WHITE)
    resolver.add_note("a texture without texture coordinates is left out")
    return None


def _add_colors(
    surface: Surface, vertex: dict[str, Any], face: dict[str, Any], face_of: NDArray[np.int64], resolver: Resolver
) -> Surface:
    """Returns the surface with the colours of its vertices, or else of its faces, if the file has any."""
    for names in _COLORS:
        if set(names) <= vertex["properties"].keys():
            colors = _read_rgba(vertex, names, resolver)
            return replace(surface, colors=colors, color=WHITE, is_see_through=True)
        if set(names) <= face["properties"].keys():
            colors = _read_rgba(face, names, resolver)[np.repeat(face_of, 3)]
            return replace(split_corners(surface), colors=colors, color=WHITE, is_see_through=True)
    return surface


def _read_rgba(element: dict[str, Any], names: tuple[str, ...], resolver: Resolver) -> NDArray[np.float32]:
    """Returns the colours `names` as RGBA `(rows, 4)`, with the first of `_ALPHAS` unless it is 0 everywhere."""
    colors = add_alpha(scale_levels(normalise(_stack(element, *names)), resolver))
    for name in _ALPHAS:
        if name in element["properties"]:
            alpha = scale_levels(normalise(_stack(element, name)), resolver)[:, 0]
            colors[:, 3] = np.clip(alpha, 0.0, 1.0) if alpha.any() else 1.0
            break
    return colors
