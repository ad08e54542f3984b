"""Reads STL, parsed by trimesh, and OFF.

trimesh 5.2 accepts STL files that are cut short and finds keywords in the names of solids; it drops the colours of OFF.
It only gets bytes in memory whose counts are within the limits, and cannot open another file.
"""

from __future__ import annotations

import io
import logging
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.meshes.geometry import add_alpha, split_corners
from ciir.renderer.readers.meshes.polygons import triangulate
from ciir.renderer.surface import DEFAULT_COLOR, WHITE, Surface, check_size

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.texture_files import Resolver

_XML_ENCODING = re.compile(rb"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']([^"'>]*)""")
_XML_ENCODINGS = (b"utf-8", b"us-ascii", b"ascii", b"iso-8859-1", b"windows-1252")
_STL_HEADER, _STL_TRIANGLE = 84, 50
_STL_NAME = re.compile(rb"(?:end)?solid\b[^\r\n]*", re.IGNORECASE)
_OFF_HEAD = re.compile(rb"(C?OFF)\s+(-?\d{1,18})\s+(-?\d{1,18})[^\n]*")

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # its warnings would be printed on standard error


def check_xml(data: bytes, name: str) -> None:
    """Raises `Unreadable` for XML with a document type: its entities could grow without limit or refer to other files.

    Encodings in which a document type could be hidden are refused, too.
    """
    declared = _XML_ENCODING.match(data.removeprefix(b"\xef\xbb\xbf"))
    if b"\0" in data or (declared and declared[1].lower() not in _XML_ENCODINGS):
        raise Unreadable(f"{name}: its XML is not in UTF-8; export it again")
    if b"<!DOCTYPE" in data:
        raise Unreadable(f"{name}: its XML has a document type, which is not read; remove it")


def read_stl(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
    """Reads all solids of an ASCII or a binary STL as one surface. Normals are computed: many writers leave them zero.

    Colours are left out, with a note: there are two ways to store them, which contradict each other.

    Raises `Unreadable` if the file is cut short, and `TooLarge` over `limits`.
    """
    from trimesh.exchange.stl import load_stl_ascii, load_stl_binary

    # Binary files may begin with "solid", too, but the highest byte of their count is zero, and text has no zero bytes.
    if data[:5].lower() == b"solid" and b"\0" not in data[:_STL_HEADER]:
        lower = data.lower()
        count = lower.count(b"endfacet")
        check_size(name, count, 3 * count, limits.triangles)
        text = b"solid\n" + _STL_NAME.sub(b"", data) + b"\nendsolid"  # as one solid: trimesh takes quadratic time
        vertices = load_stl_ascii(io.BytesIO(text if text.isascii() else b"")).get("vertices", np.empty((0, 3)))
        if len(vertices) != 3 * count or b"endsolid" not in lower:
            raise Unreadable(
                f"{name}: an ASCII STL of {len(vertices):,} vertices in {count:,} facets: cut short; give it again"
            )
    else:
        count = int.from_bytes(data[80:_STL_HEADER], "little")
        size = _STL_HEADER + _STL_TRIANGLE * count
        if len(data) < max(size, _STL_HEADER):
            raise Unreadable(
                f"{name}: a binary STL of {count:,} triangles in {len(data):,} bytes: cut short; give it again"
            )
        check_size(name, count, 3 * count, limits.triangles)
        last = data[
            _STL_HEADER + _STL_TRIANGLE - 1 : size : _STL_TRIANGLE
        ]  # of each triangle; the highest bit marks a colour
        if b"COLOR=" in data[:80] or max(last, default=0) & 0x80:
            resolver.add_note("the colours of an STL are left out; export it as PLY, OBJ or GLB")
        vertices = load_stl_binary(io.BytesIO(data[:size])).get("vertices", np.empty((0, 3)))
    return [Surface(vertices.astype(np.float64), np.arange(len(vertices)).reshape(-1, 3), color=DEFAULT_COLOR)]


def read_off(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
    """Reads the faces of an ASCII OFF or COFF as one surface, with the colours of its vertices, or else of its faces.

    Raises `Unreadable` if the file is cut short, and `TooLarge` over `limits`.
    """
    lines = io.BytesIO(data.removeprefix(b"\xef\xbb\xbf").replace(b"\r", b"\n"))
    rows = [row for line in lines if (row := line.partition(b"#")[0].strip())]
    head = _OFF_HEAD.match(b"\n".join(rows))
    if head is None:
        raise Unreadable(f"{name}: an OFF without counts of vertices and faces; export it again")
    vertex_count, face_count = int(head[2]), int(head[3])
    rows = rows[head[0].count(b"\n") + 1 :]
    if min(vertex_count, face_count) < 0 or vertex_count + face_count > len(rows):
        raise Unreadable(
            f"{name}: an OFF of {vertex_count:,} vertices and {face_count:,} faces in {len(rows):,} lines: cut short; "
            "give it again"
        )
    check_size(name, face_count, vertex_count, limits.triangles)
    faces = [face.split() for face in rows[vertex_count : vertex_count + face_count]]
    lengths = np.fromiter((int(face[0]) for face in faces), np.int64, face_count)
    check_size(name, int(np.maximum(lengths - 2, 0).sum()), vertex_count, limits.triangles)
    for number, (face, length) in enumerate(zip(faces, lengths, strict=True)):
        if not 0 <= length < len(face):
            raise Unreadable(f"{name}: OFF face {number} has fewer corners than its count; export it again")
    points = [row.split(None, 7)[:7] for row in rows[:vertex_count]]
    if min(map(len, points), default=3) < 3:
        raise Unreadable(f"{name}: an OFF vertex with fewer than three numbers; export it again")
    vertices = np.array([point[:3] for point in points], np.float64).reshape(-1, 3)
    corners = np.fromiter((int(word) for face in faces for word in face[1 : 1 + int(face[0])]), np.int64)
    triangles, face_of = triangulate(vertices, corners, lengths, resolver.add_note)
    surface = Surface(vertices, corners[triangles], color=DEFAULT_COLOR)
    if head[1] == b"COFF" and vertex_count:
        return [replace(surface, colors=_read_colors([point[3:6] for point in points]), color=WHITE)]
    painted = [face[1 + length : 4 + length] for face, length in zip(faces, lengths.tolist(), strict=True)]
    if not len(triangles) or not any(painted):
        return [surface]
    try:
        colors = _read_colors(painted)[np.repeat(face_of, 3)]
    except ValueError:  # words, or rows of other lengths: a single number would be an index into a colour map
        resolver.add_note("colours that are not red, green and blue of every face are left out")
        return [surface]
    return [replace(split_corners(surface), colors=colors, color=WHITE)]


def _read_colors(rows: list[list[bytes]]) -> NDArray[np.float32]:
    """Reads rows of red, green and blue as RGBA `(n, 4)`. Values are from 0 to 1, or to 255 if one is above 1. Raises
    `ValueError` for other rows.
    """
    colors = np.array(rows, np.float64).reshape(len(rows), 3).astype(np.float32)
    return add_alpha(colors / (255 if colors.max() > 1 else 1))
