"""OFF to a surface: polygons, with vertex colours where it is COFF (Geomview's Object File Format).

Read by this project's own code and not by trimesh 5.2, which drops the colours of COFF without a word, so that a
coloured model comes out grey.
"""

from __future__ import annotations

import io
from array import array
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.meshes.polygons import fans, numbers
from ciir.renderer.readers.names import clean_text
from ciir.renderer.surface import DEFAULT_COLOR, Surface, check_size

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.texture_files import Resolver


def read(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:  # noqa: ARG001
    """The faces of an ASCII OFF or COFF as one surface. Colours of faces are left aside.

    Raises `Unreadable` where it is cut short; `TooLarge` over the limits; `ValueError` where a number isn't one.
    """
    lines = _lines(data)
    keyword, *first = next(lines, b"").split(None, 3)
    counts = first or next(lines, b"").split(None, 2)  # some writers put the counts after the keyword
    vertex_count, face_count = int(counts[0]), int(counts[1])
    most = data.count(b"\n") + data.count(b"\r")
    if min(vertex_count, face_count) < 0 or vertex_count + face_count > most:
        raise Unreadable(_cut_short(name, vertex_count, face_count, most))
    check_size(name, face_count, vertex_count, limits.triangles)
    colored = keyword == b"COFF"
    width = 6 if colored else 3
    rows = list(islice(lines, vertex_count))
    faces = list(islice(lines, face_count))
    if len(rows) + len(faces) < vertex_count + face_count:
        raise Unreadable(_cut_short(name, vertex_count, face_count, len(rows) + len(faces)))
    vertices = numbers(token for row in rows for token in row.split(None, width)[:width]).reshape(vertex_count, width)
    corners, lengths = array("q"), array("q")
    for number, face in enumerate(faces):
        words = face.split()
        length = int(words[0])
        if not 0 <= length < len(words):
            raise Unreadable(f"{name}: OFF face {number} has fewer corners than it says; export it again")
        corners.extend(map(int, words[1 : length + 1]))
        lengths.append(length)
    sides = np.array(lengths, np.int64)
    check_size(name, int(np.maximum(sides - 2, 0).sum()), vertex_count, limits.triangles)
    triangles = np.array(corners, np.int64)[fans(sides)[0]]
    colors = None
    if colored and vertex_count:
        colors = np.ones((vertex_count, 4), np.float32)
        colors[:, :3] = vertices[:, 3:] / (255 if vertices[:, 3:].max() > 1 else 1)
    color = DEFAULT_COLOR if colors is None else (1.0, 1.0, 1.0, 1.0)
    return [Surface(vertices[:, :3], triangles, colors=colors, color=color)]


def _lines(data: bytes) -> Iterator[bytes]:
    """The lines that hold something, without their comments."""
    for line in io.BytesIO(data.removeprefix(b"\xef\xbb\xbf").replace(b"\r", b"\n")):
        if text := line.partition(b"#")[0].strip():
            yield text


def _cut_short(name: str, vertex_count: int, face_count: int, lines: int) -> str:
    counts = f"{clean_text(f'{vertex_count:,}')} vertices and {clean_text(f'{face_count:,}')} faces"
    return f"{name}: an OFF of {counts} in {lines:,} lines: cut short; give it again"
