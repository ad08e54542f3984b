"""Bounds and triangles of a scene, and its transforms."""

import numpy as np

from ciir.renderer.scene import Part, Scene

SQUARE = np.array([[0, 0, 0], [2, 0, -1], [0, 3, 0], [2, 3, -1]], float)
FACES = np.array([[0, 1, 2], [2, 1, 3]], np.int32)


def part(vertices):
    return Part(vertices, FACES, np.ones((len(vertices), 4), np.float32))


def test_bounds_are_of_the_vertices_that_triangles_use():
    # Files hold control points far from the object, with which it would be framed as a speck.
    stray = part(np.concatenate([SQUARE, [[-50.0, 0, 0], [0, 0, 900]]]))
    np.testing.assert_array_equal(Scene((stray,)).bounds(), [[0, 0, -1], [2, 3, 0]])
    np.testing.assert_array_equal(Scene((stray, part(SQUARE + 1))).bounds(), [[0, 0, -1], [3, 4, 1]])


def test_a_transformed_scene_has_transformed_bounds():
    matrix = np.diag([2.0, 2, 2, 1])
    matrix[:3, 3] = (1, 0, -5)
    np.testing.assert_array_equal(Scene((part(SQUARE),)).transform(matrix).bounds(), [[1, 0, -7], [5, 6, -5]])


def test_a_culled_scene_keeps_its_bounds_until_it_is_transformed():
    extent = np.array([[-9.0, -9, -9], [9, 9, 9]])
    culled = Scene((part(SQUARE),), extent=extent)
    assert culled.bounds() is extent
    np.testing.assert_array_equal(culled.transform(np.eye(4)).bounds(), [[0, 0, -1], [2, 3, 0]])
