"""STL, ASCII and binary, to a surface: triangles without colour, whose normals are computed.

Read by this project's own code and not by trimesh 5.2, which finds its keywords in the names of solids and believes
any count; vetting that for it takes more lines than the format does.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.meshes.polygons import numbers
from ciir.renderer.surface import DEFAULT_COLOR, Surface, check_size

if TYPE_CHECKING:
    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.texture_files import Resolver

_HEADER = 84
_RECORD = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attributes", "<u2")])
_VERTEX = re.compile(rb"\bvertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.IGNORECASE)


def read(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:  # noqa: ARG001
    """All solids of an STL as one surface. Facet normals are left aside: many writers leave them zero.

    Raises `Unreadable` where it is cut short; `TooLarge` over the limits; `ValueError` where a number isn't one.
    """
    count = int.from_bytes(data[80:_HEADER], "little")
    # Binary files may begin with "solid" too; but the highest byte of their count is zero, and text has no zeros.
    if data[:5].lower() == b"solid" and b"\0" not in data[:_HEADER]:
        vertices = _ascii(data, name, limits.triangles)
    elif len(data) >= _HEADER and len(data) >= _HEADER + _RECORD.itemsize * count:
        check_size(name, count, 3 * count, limits.triangles)
        vertices = np.frombuffer(data, _RECORD, count, _HEADER)["vertices"].reshape(-1, 3).astype(np.float64)
    else:
        raise Unreadable(
            f"{name}: a binary STL of {count:,} triangles in {len(data):,} bytes: cut short; give it again"
        )
    return [Surface(vertices, np.arange(len(vertices)).reshape(-1, 3), color=DEFAULT_COLOR)]


def _ascii(data: bytes, name: str, max_triangles: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    facets = data.lower().count(b"endfacet")
    check_size(name, facets, 3 * facets, max_triangles)
    vertices = numbers(token for match in _VERTEX.finditer(data) for token in match.groups()).reshape(-1, 3)
    if len(vertices) != 3 * facets or b"endsolid" not in data.lower():
        raise Unreadable(
            f"{name}: an ASCII STL of {len(vertices):,} vertices in {facets:,} facets: cut short; give it again"
        )
    return vertices
