"""Splits polygons into triangles. Fans are used unless they would extend beyond their polygon; otherwise ears are cut
off one by one (Meisters, "Polygons have ears", 1975)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

FLAT = 1e-3
"""The cosine up to which a triangle that faces away from its polygon is taken for an edge-on one that was rounded."""
MOST_WORK = 30_000_000
"""The most points that are compared with ears, in all polygons of a file together. This takes a few seconds."""
_TEST = 20
"""The number of points whose comparison takes as long as the rest of the work on an ear."""
Point = tuple[float, float]


def triangulate_fans(lengths: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Splits polygons into fans about their first corners. Returns triangles `(m, 3)` and the polygon `(m,)` of each.

    `lengths` `(n,)` is the number of corners of each polygon. A triangle's corners are indices into the list of the
    corners of all polygons. Polygons with fewer than three corners have no triangles.
    """
    counts = np.maximum(lengths - 2, 0)
    source = np.repeat(np.arange(len(lengths)), counts)
    first = (np.cumsum(lengths) - lengths)[source]
    step = np.arange(len(source)) - (np.cumsum(counts) - counts)[source]
    return np.stack([first, first + step + 1, first + step + 2], axis=1), source


def triangulate(
    vertices: NDArray[np.floating],
    corners: NDArray[np.integer],
    lengths: NDArray[np.integer],
    add_note: Callable[[str], None],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Splits polygons as `triangulate_fans` does, but so that no triangle extends beyond its polygon. If one may still
    do so, `add_note` is called with a note.

    `corners` `(k,)` are indices into `vertices` `(n, 3)`, polygon after polygon.
    """
    triangles, source = triangulate_fans(lengths)
    starts, normals = _find_hollow(vertices, corners[triangles], source)
    work, kept = [MOST_WORK], 0
    for start, normal in zip(starts.tolist(), normals, strict=True):
        length = int(lengths[source[start]])
        if (length - 2) * _TEST > work[0]:
            kept += 1
            continue
        first = int(triangles[start, 0])
        axis = int(np.abs(normal).argmax())  # the polygon is viewed along this axis, counterclockwise
        across, up = ((axis + 1) % 3, (axis + 2) % 3)[:: 1 if normal[axis] > 0 else -1]
        seen = vertices[corners[first : first + length]]
        ears = _cut_ears(list(zip(seen[:, across].tolist(), seen[:, up].tolist(), strict=True)), work)
        if ears is None:
            kept += 1
        else:
            triangles[start : start + length - 2] = first + np.array(ears)
    if kept:
        add_note(
            f"{kept:,} polygons cross themselves, or are not convex and have too many corners: they may be drawn "
            "beyond their outlines; triangulate the mesh and export it again"
        )
    return triangles, source


def _find_hollow(
    vertices: NDArray[np.floating], triangles: NDArray[np.integer], source: NDArray[np.integer]
) -> tuple[NDArray[np.intp], NDArray[np.floating]]:
    """Finds the polygons whose fan extends beyond them: one of its triangles faces the opposite way to the polygon.
    Returns the number of the first triangle `(h,)` and the normal `(h, 3)` of each such polygon.

    `triangles` `(m, 3)` are indices into `vertices`. `source` `(m,)` is the polygon of each triangle, ascending.
    """
    starts = np.flatnonzero(np.diff(source, prepend=-1))
    counts = np.diff(starts, append=len(source))
    split = np.repeat(counts > 1, counts)
    if not split.any() or triangles.min() < 0 or triangles.max() >= len(vertices):  # an error is raised later
        return np.empty(0, np.intp), np.empty((0, 3))
    columns = np.ascontiguousarray(vertices.T)
    first, second, third = (columns[:, corners] for corners in triangles[split].T)  # (3, s) each
    areas = np.cross(second - first, third - first, axis=0)
    starts, counts = starts[counts > 1], counts[counts > 1]
    own = np.cumsum(counts) - counts
    normals = np.add.reduceat(areas, own, axis=1)
    whole = np.repeat(normals, counts, axis=1)
    limits = -FLAT * np.linalg.norm(areas, axis=0) * np.linalg.norm(whole, axis=0)
    hollow = np.logical_or.reduceat((areas * whole).sum(axis=0) < limits, own)
    return starts[hollow], normals[:, hollow].T


def _cut_ears(points: Sequence[Point], work: list[int]) -> list[tuple[int, int, int]] | None:
    """Returns the triangles of a polygon whose corners run counterclockwise, as indices into `points`. Returns None if
    the polygon crosses itself, or if `work`, the number of points that may still be compared, runs out.
    """
    count = len(points)
    # The remaining corners as linked neighbours: removing one from a list would move all corners after it.
    before, after = [count - 1, *range(count - 1)], [*range(1, count), 0]
    # Only a corner that is not convex can lie in an ear, and cutting ears off makes no new corner of that kind.
    bent = {
        corner: points[corner]
        for corner in range(count)
        if _turn(points[before[corner]], points[corner], points[after[corner]]) <= 0
    }
    ears = []
    corner = missed = 0
    while count > 2:
        last, following = before[corner], after[corner]
        ear = points[last], points[corner], points[following]
        work[0] -= len(bent) + _TEST
        is_repeated = ear[1] in (ear[0], ear[2])  # cuts nothing off
        if is_repeated or (_turn(*ear) > 0 and not any(_lies_in(ear, point) for point in bent.values())):
            ears.append((last, corner, following))
            after[last], before[following] = following, last
            bent.pop(corner, None)
            count -= 1
            corner, missed = after[following], 0  # skip the next corner, which would make a fan of slivers
        else:
            corner, missed = following, missed + 1
        if missed > count or work[0] < 0:
            return None
    return ears


def _turn(a: Point, b: Point, c: Point) -> float:
    """Returns twice the area of a triangle, positive if its corners run counterclockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _lies_in(ear: tuple[Point, Point, Point], point: Point) -> bool:
    """Checks whether `point` lies in a triangle or on its sides, but not on its corners: where a hole is joined to the
    outline, two corners have the same position."""
    a, b, c = ear
    return _turn(a, b, point) >= 0 and _turn(b, c, point) >= 0 and _turn(c, a, point) >= 0 and point not in ear
