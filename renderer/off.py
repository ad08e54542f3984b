"""OFF to a surface: polygons, with vertex colours where it is COFF (Geomview's Object File Format).

Read by this project's own code and not by trimesh 5.2, which drops the colours of COFF without a word, so that a
coloured model comes out grey.
"""

from __future__ import annotations

import re

import numpy as np

from renderer.errors import Unreadable
from renderer.names import shown
from renderer.polygons import fans
from renderer.surface import PLAIN, Surface

_COMMENT = re.compile(rb"#[^\n]*")


def surfaces(data: bytes, *, name: str) -> list[Surface]:
    """The faces of an ASCII OFF or COFF as one surface. Colours of faces are left aside.

    Raises `Unreadable` where it is cut short; `ValueError` where a number isn't one.
    """
    lines = [line.split() for line in _COMMENT.sub(b"", data.removeprefix(b"\xef\xbb\xbf")).splitlines()]
    lines = [line for line in lines if line]
    keyword, first = lines[0][0], lines[0][1:]
    body = lines[1:] if not first else [first, *lines[1:]]  # some writers put the counts after the keyword
    vertex_count, face_count = int(body[0][0]), int(body[0][1])
    if not 0 <= vertex_count <= len(body) - 1 or not 0 <= face_count <= len(body) - 1 - vertex_count:
        raise Unreadable(
            f"{name}: an OFF of {shown(f'{vertex_count:,}')} vertices and {shown(f'{face_count:,}')} faces "
            f"in {len(body) - 1:,} lines: "
            "cut short; give it again"
        )
    colored = keyword == b"COFF"
    width = 6 if colored else 3
    vertices = np.array([line[:width] for line in body[1 : vertex_count + 1]]).astype(np.float64).reshape(-1, width)
    rows = body[vertex_count + 1 : vertex_count + 1 + face_count]
    polygons = [row[1 : int(row[0]) + 1] for row in rows]
    if any(int(row[0]) != len(polygon) for row, polygon in zip(rows, polygons, strict=True)):
        raise Unreadable(f"{name}: an OFF face with fewer corners than it says; export it again")
    faces, _ = fans(polygons)
    colors = None
    if colored and vertex_count:
        colors = np.ones((vertex_count, 4), np.float32)
        colors[:, :3] = vertices[:, 3:] / (255 if vertices[:, 3:].max() > 1 else 1)
    color = PLAIN if colors is None else (1.0, 1.0, 1.0, 1.0)
    return [Surface(vertices[:, :3], faces, colors=colors, color=color)]
