"""Vertices of one cell become one."""

import numpy as np

from benchmarks.simplified import simplified
from renderer.scene import Part, Scene


def grid(side):
    """A square of 1, `side` quadrilaterals along each edge."""
    y, x = (each.ravel() for each in np.mgrid[: side + 1, : side + 1])
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    quads = np.stack([corner, corner + 1, corner + side + 2, corner + side + 1], axis=1)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    vertices = np.stack([x, y, 0 * x], axis=1) / side
    return Scene((Part(vertices, faces, np.ones((len(vertices), 4), np.float32)),))


def area(scene):
    corners = scene.parts[0].vertices[scene.parts[0].faces]
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2


def test_a_flat_square_stays_one_with_fewer_triangles():
    fine = grid(32)
    copy = simplified(fine, 1 / 8)
    assert copy.triangles == 2 * 8**2
    assert np.isclose(area(copy), 1)


def test_cells_finer_than_the_mesh_change_nothing():
    fine = grid(8)
    copy = simplified(fine, 1 / 100)
    assert copy.triangles == fine.triangles
    assert np.isclose(area(copy), area(fine))
