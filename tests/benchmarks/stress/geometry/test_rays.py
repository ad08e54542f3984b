"""The slow reference against sums done by hand, and Embree against it."""

from dataclasses import replace

import numpy as np
import pytest

from ciir.benchmarks.stress.geometry import shapes
from ciir.benchmarks.stress.geometry.rays import build_embree_sight, build_slow_sight
from ciir.renderer.scene import Part, Scene, Texture

CORNERS = np.array([[0.0, 0.0, -2.0], [4.0, 0.0, -2.0], [0.0, 4.0, -6.0]])
FACE = np.array([[0, 1, 2]], np.int32)
STRAIGHT = np.array([0.0, 0.0, -1.0])


@pytest.mark.parametrize("look", [build_slow_sight, build_embree_sight])
def test_weights_by_hand(look):
    """At (1, 2) the triangle's weights are 1/4, 1/4 and 1/2."""
    sight = look(Scene((Part(CORNERS, FACE, shapes.add_alpha(np.diag([0.4, 0.8, 1.0]))),)))
    seen = sight(np.array([[1.0, 2.0, 0.0], [3.0, 3.0, 0.0]]), STRAIGHT)
    np.testing.assert_allclose(seen, [[25.5, 51.0, 127.5, 255.0], [0, 0, 0, 0]], atol=1e-4)


@pytest.mark.parametrize("look", [build_slow_sight, build_embree_sight])
def test_the_nearest_that_is_there_is_seen(look):
    clear, solid = shapes.make_sheet(3.0, 9.0, shapes.RED, cutoff=0.5), shapes.make_sheet(4.0, 9.0, shapes.GREEN)
    behind = shapes.make_sheet(5.0, 9.0, shapes.RED)
    sight = look(Scene((behind, solid, clear)))
    np.testing.assert_array_equal(sight(np.array([[1.0, 2.0, 0.0]]), STRAIGHT), [[0, 255, 0, 255]])
    before = replace(behind, vertices=behind.vertices + np.array([0, 0, 7.0]))  # before the array
    sight = look(Scene((solid, before)))
    np.testing.assert_array_equal(sight(np.array([[1.0, 2.0, 0.0]]), STRAIGHT), [[255, 0, 0, 255]])


@pytest.mark.parametrize("look", [build_slow_sight, build_embree_sight])
def test_what_is_see_through_is_blended(look):
    red, solid = shapes.make_sheet(3.0, 9.0, shapes.RED), shapes.make_sheet(4.0, 9.0, shapes.GREEN)
    thin = replace(red, colors=shapes.add_alpha(red.colors[:, :3], 0.25), is_see_through=True)
    for parts, seen in (((solid, thin), [63.75, 191.25, 0, 255]), ((thin,), [63.75, 0, 0, 63.75])):
        np.testing.assert_allclose(look(Scene(parts))(np.array([[1.0, 2.0, 0.0]]), STRAIGHT), [seen], rtol=1e-6)


def test_textures_are_looked_up_where_the_weights_say():
    pixels = np.zeros((4, 4, 4), np.uint8)
    pixels[..., 3], pixels[1, 2] = 255, (200, 100, 50, 255)
    uv = np.array([[0.625, 0.625], [1.0, 0.0], [0.0, 1.0]], np.float32)  # the first: that texel's centre
    part = Part(CORNERS, FACE, shapes.add_alpha(np.ones((3, 3))), uv, Texture(pixels))
    seen = build_slow_sight(Scene((part,)))(np.array([[0.0, 0.0, 0.0]]), STRAIGHT)
    np.testing.assert_allclose(seen, [[200, 100, 50, 255]], atol=1e-9)


def test_no_ray_falls_between_triangles():
    scene = shapes.make_mosaic(6, side=6.0, distance=3.0)
    y, x = np.mgrid[-5:6, -5:6] / 2.0  # corners, edges and middles of the squares
    seen = build_slow_sight(scene)(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), STRAIGHT)
    np.testing.assert_allclose(seen[:, :3], 255 * shapes.compute_ramp(x.ravel(), y.ravel(), 6.0), atol=1e-4)
