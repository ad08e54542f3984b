"""Embree against a slow, readable ray caster."""

import numpy as np
import pytest

from ciir.renderer.backends import embree
from ciir.renderer.backends.raytrace import RaytraceBackend, list_rays
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Part, Scene, Texture

ARRAY = LensArray(9, 11, 3, 5, pitch=0.5, delta=0.1)


def triangles(count=6, seed=0, cutoff=None, *, is_see_through=False, z=-5):
    """Large random triangles about `z`, some of them textured, with random vertex colours."""
    random = np.random.default_rng(seed)
    vertices = random.uniform(-3, 3, (3 * count, 3)) + np.array([0, 0, z])
    colors = random.uniform(0, 1, (3 * count, 4)).astype(np.float32)
    uv = random.uniform(-1, 2, (3 * count, 2)).astype(np.float32)
    # A texture that varies slowly, so that the last bit of uv does not show.
    y, x = np.mgrid[:64, :64] / 64
    waves = [np.sin(2 * np.pi * (a * x + b * y)) for a, b in ((1, 0), (0, 1), (1, 1), (1, -1))]
    texture = Texture(np.stack([127.5 + 127.5 * wave for wave in waves], -1).astype(np.uint8))
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    half = count // 2
    return Scene(
        (
            Part(vertices, faces[:half], colors, uv, texture, cutoff, is_see_through),
            Part(vertices, faces[half:], colors, is_see_through=is_see_through),
        )
    )


def reference(scene, origin, direction, background):
    """RGBA and depth of one line: every triangle is tried, near ones first, and each is laid over what follows."""
    hits = []
    for part in scene.parts:
        for face in part.faces:
            a, b, c = part.vertices[face]
            solution = np.linalg.solve(np.stack([b - a, c - a, -direction], 1), origin - a)
            s, t, distance = solution
            if s >= 0 and t >= 0 and s + t <= 1:
                hits.append((distance, part, face, np.array([1 - s - t, s, t])))
    total, through, depth = np.zeros(3), 1.0, np.inf
    for distance, part, face, weights in sorted(hits, key=lambda hit: hit[0]):
        rgba = weights @ part.colors[face].astype(float)
        if part.texture is not None:
            u, v = weights @ part.uv[face].astype(float)
            rgba = rgba * bilinear(part.texture.pixels, u, v)
        alpha = rgba[3] if part.is_see_through else float(rgba[3] >= (part.alpha_cutoff or 0))
        total, through = total + through * alpha * np.clip(rgba[:3], 0, 1), through * (1 - alpha)
        depth = distance if alpha >= 0.5 and depth == np.inf else depth
    return [*(total * 255 + through * np.array(background)), 255 * (1 - through), depth]


def bilinear(pixels, u, v):
    height, width = pixels.shape[:2]
    x, y = u * width - 0.5, (1 - v) * height - 0.5
    total = np.zeros(4)
    for column in (int(np.floor(x)), int(np.floor(x)) + 1):
        for row in (int(np.floor(y)), int(np.floor(y)) + 1):
            total += (1 - abs(x - column)) * (1 - abs(y - row)) * pixels[row % height, column % width]
    return total / 255


@pytest.mark.parametrize("alpha", [{}, {"cutoff": 0.25}, {"is_see_through": True}])
@pytest.mark.parametrize("z", [-5, 0, 5])  # behind the array, astride and before it
@pytest.mark.parametrize("seed", range(2))
def test_views_match_the_slow_caster(seed, z, alpha):
    scene = triangles(seed=seed, z=z, **alpha)
    background = (10, 200, 30)
    for v, u in ((0, 0), (1, 2), (2, 4)):
        (view,) = RaytraceBackend().render_views(scene, ARRAY, [(v, u)], background=background)
        (depth,) = RaytraceBackend().render_depth(scene, ARRAY, [(v, u)])
        direction = np.array([(u - 2) * 0.1, (1 - v) * 0.1, -1.0])
        expected = np.array(
            [
                [
                    reference(scene, np.array([(x - 5) * 0.5, (4 - y) * 0.5, 0.0]), direction, background)
                    for x in range(11)
                ]
                for y in range(9)
            ]
        )
        # A ray that grazes an edge may fall on either side of it in float32. Where a surface is blended with the
        # background, colour, alpha and their sum are each rounded to 8 bits.
        differ = np.abs(view - expected[..., :4]).max(-1) > (1.5 if scene.is_see_through else 1.0)
        assert differ.sum() <= 1
        np.testing.assert_allclose(depth[~differ], expected[..., 4][~differ], rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("gap", [5.0, 1e-3])
def test_a_ray_passes_cut_out_layers(gap):
    square = np.array([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    clear = np.tile(np.float32([1, 0, 0, 0.2]), (4, 1))
    solid = np.tile(np.float32([0, 1, 0, 1.0]), (4, 1))
    layers = [Part(square - [0, 0, 20 + gap * i], faces, clear, alpha_cutoff=0.5) for i in range(8)]
    scene = Scene((*layers, Part(square - [0, 0, 20 + gap * 8], faces, solid)))
    (view,) = RaytraceBackend().render_views(scene, LensArray(4, 4, 1, 1), [(0, 0)])
    np.testing.assert_array_equal(view, np.broadcast_to(np.uint8([0, 255, 0, 255]), view.shape))
    (depth,) = RaytraceBackend().render_depth(scene, LensArray(4, 4, 1, 1), [(0, 0)])
    np.testing.assert_allclose(depth, 20 + gap * 8, rtol=1e-6)


@pytest.mark.parametrize("cutoff", [None, 0.6])
def test_an_alpha_that_is_just_enough_is_enough_everywhere(cutoff):
    square = np.array([[-9, -9, -20], [9, -9, -20], [9, 9, -20], [-9, 9, -20]], float)
    color = np.tile(np.float32([1, 0, 0, cutoff or 0.5]), (4, 1))
    part = Part(square, np.array([[0, 1, 2], [0, 2, 3]], np.int32), color, None, None, cutoff, cutoff is None)
    array = LensArray(64, 64, 1, 1, pitch=0.1)
    (depth,) = RaytraceBackend().render_depth(Scene((part,)), array, [(0, 0)])
    np.testing.assert_allclose(depth, 20, rtol=1e-6)
    (view,) = RaytraceBackend().render_views(Scene((part,)), array, [(0, 0)])
    assert view.std(axis=(0, 1)).max() < 0.5


def stack_sheets(count, alpha, gap=0.01, z=0.3):
    """White sheets that hide a share `alpha` each, the first at `z`, before a green one."""
    square = np.array([[-9, -9, z], [9, -9, z], [9, 9, z], [-9, 9, z]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    colors = [np.tile(np.float32(color), (4, 1)) for color in ([1, 1, 1, alpha], [0, 1, 0, 1])]
    sheets = [Part(square - [0, 0, gap * i], faces, colors[0], is_see_through=True) for i in range(count)]
    return Scene((*sheets[::-1], Part(square - [0, 0, gap * count], faces, colors[1])))


@pytest.mark.parametrize("count", [1, 7, 63])
def test_sheets_dim_what_is_behind_by_a_power(count):
    notes = set()
    (view,) = RaytraceBackend().render_views(stack_sheets(count, 0.05), ARRAY, [(0, 1)], notes=notes)
    red = 255 * (1 - 0.95**count)
    assert np.abs(view - np.array([red, 255, red, 255])).max() <= 0.51
    assert notes == set()
    (depth,) = RaytraceBackend().render_depth(stack_sheets(count, 0.05), ARRAY, [(0, 1)])
    # Each is less than half opaque. float32 steps from sheet to sheet, a millionth of the longest side each.
    np.testing.assert_allclose(depth, 0.01 * count - 0.3, atol=1e-6 * 18)


def test_a_ray_that_passes_too_many_surfaces_ends_with_a_note():
    notes = set()
    (view,) = RaytraceBackend().render_views(stack_sheets(64, 0.05), ARRAY, [(0, 1)], notes=notes)
    assert np.abs(view - 255 * (1 - 0.95**64)).max() <= 0.51
    assert notes == {embree.PASSED}


def test_a_see_through_triangle_is_met_once_at_any_angle():
    """Rays almost in its plane: rounding along them exceeds the step behind it."""
    y = np.array([-0.6, -0.6, 120.1, -3000, -3000, -3000])  # the last three are far away, so that coordinates round
    corners = np.column_stack([[-900, 900, 0, 0, 1, 0], y, [2, 2, -400, 0, 0, -1]])
    thin = np.tile(np.float32([1, 1, 1, 0.6]), (6, 1))
    scene = Scene((Part(corners, np.arange(6, dtype=np.int32).reshape(2, 3), thin, is_see_through=True),))
    (view,) = RaytraceBackend().render_views(scene, LensArray(301, 5, 3, 1, pitch=1e-3, delta=0.3), [(0, 0)])
    assert (view[..., 3] == 153).sum() > 400
    assert set(np.unique(view[..., 3])) == {0, 153}


def test_levels_are_those_of_the_colours_that_rays_meet():
    prepared, array = embree.PreparedScene(triangles()), LensArray(9, 11, 1, 1, pitch=0.25, delta=0.1)
    ((_, origins, direction),) = list_rays(array, [(0, 0)])
    colours = prepared.cast(origins, direction)[0]
    assert 0 < np.count_nonzero(colours[:, 3]) < len(colours)
    np.testing.assert_array_equal(prepared.cast_levels(origins, direction), (colours * 255 + 0.5).astype(np.uint8))


def test_reverses_are_found_only_if_a_ray_meets_a_hidden_back():
    corners = np.array([[-3.0, -3, -6], [3, -3, -6], [0, 3, -6]])
    vertices = np.concatenate([corners, corners + np.array([0, 0, 2])])  # both face +z
    part = Part(vertices, np.arange(6, dtype=np.int32).reshape(2, 3), np.ones((6, 4), np.float32), hides_back=True)
    prepared = embree.PreparedScene(Scene((part,)))
    assert "_fronts" not in vars(prepared)
    prepared.cast(np.zeros((1, 3)), np.array([0, 0, -1.0]))
    assert "_fronts" not in vars(prepared)
    prepared.cast(np.array([[0, 0, -9.0]]), np.array([0, 0, 1.0]))
    assert "_fronts" in vars(prepared)
