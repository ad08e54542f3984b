"""Both backends against each other and against the geometry: colour and depth."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Part, Scene, Texture
from ciir.renderer.scenes import SCENES, load_scene
from ciir.renderer.shading import encode_srgb
from tests.support.backends import ARRAY, BACKENDS, find_disagreements, place_scene, require_backend

MESHES = ["duck.glb", "spot/spot.obj", "fuze/fuze.obj", "milk-truck.glb"]
CORNERS_AND_MIDDLE = [(0, 0), (0, 14), (7, 7), (14, 0), (14, 14)]


@pytest.mark.parametrize("name", [*SCENES, *MESHES])
@pytest.mark.parametrize("samples", [1, 2])
def test_raster_draws_what_rays_meet(name, samples):
    raster, raytrace = map(require_backend, BACKENDS)
    placed = place_scene(name)
    views = [
        np.stack(list(b.render_views(placed, ARRAY, CORNERS_AND_MIDDLE, samples=samples))) for b in (raster, raytrace)
    ]
    assert views[1][..., 3].any(axis=(1, 2)).all()
    textured = any(part.texture is not None for part in placed.parts)
    if samples == 1:
        assert find_disagreements(*views, textured=textured) == []
    # Where samples are averaged a shifted picture differs along every edge: by 2 to 10 grey levels over the object.
    covered = views[1][..., 3] > 0
    assert np.abs(views[0].astype(float) - views[1])[covered].mean() < 0.5


@pytest.mark.parametrize("name", ["hamburger", "duck.glb"])
@pytest.mark.parametrize("broken", ["shear sign", "half a pixel in x", "half a pixel in y", "upside down"])
def test_the_comparison_notices(name, broken, monkeypatch):
    raster, raytrace = map(require_backend, BACKENDS)
    from ciir.renderer.backends import raster as module
    from ciir.renderer.backends.projections import make_oblique_matrix

    def wrong(array, view, near, far):
        matrix = make_oblique_matrix(array, view, near, far)
        if broken == "shear sign":
            matrix[:2, 2] *= -1
        elif broken == "half a pixel in x":
            matrix[0, 3] += 1 / array.cols
        elif broken == "half a pixel in y":
            matrix[1, 3] += 1 / array.rows
        else:
            matrix[1] *= -1
        return matrix

    placed = place_scene(name)
    exact = np.stack(list(raytrace.render_views(placed, ARRAY, CORNERS_AND_MIDDLE)))
    monkeypatch.setattr(module, "make_oblique_matrix", wrong)
    assert find_disagreements(
        np.stack(list(raster.render_views(placed, ARRAY, CORNERS_AND_MIDDLE))), exact, textured=True
    )


def make_cut_outs(wrap, *, is_nearest=False):
    """Two sheets at z = -30 and -40; the near one has holes where its texture's alpha times its vertices' is low."""
    y, x = np.mgrid[:48, :64]
    alpha = 127.5 + 127.5 * np.sin(x / 5.0) * np.cos(y / 6.0)
    pixels = np.stack([x * 4, y * 5, 255 - x * 3, alpha], axis=-1).astype(np.uint8)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uv = (corners[:, :2] * 1.7 + 0.3).astype(np.float32)
    texture = Texture(pixels, *wrap, is_nearest)
    thin, solid = np.ones((4, 4), np.float32), np.ones((4, 4), np.float32)
    thin[:, 3] = [0.6, 0.8, 1.0, 0.7]
    solid[:, 3] = 0.1  # ignored without a cutoff
    return Scene(
        (
            Part(corners * 20 - [0, 0, 30], faces, thin, uv, texture, alpha_cutoff=0.3),
            Part(corners * 24 - [0, 0, 40], faces, solid, uv, texture),
        )
    )


@pytest.mark.parametrize("wrap", [("repeat", "mirror"), ("mirror", "clamp"), ("clamp", "repeat")])
def test_cut_outs_and_wraps_agree(wrap):
    raster, raytrace = map(require_backend, BACKENDS)
    array = LensArray(160, 160, 3, 3, pitch=0.3125)
    made = [np.stack(list(b.render_views(make_cut_outs(wrap), array, [(0, 2), (1, 1)]))) for b in (raster, raytrace)]
    assert find_disagreements(*made, textured=True) == []
    # A hole that is there in one alone, or another copy of the texture, is worth tens of grey levels.
    differ = np.abs(made[0].astype(int) - made[1]).max(-1) > 3
    assert differ.mean() < 0.003


def test_nearest_texels_agree():
    array = LensArray(160, 160, 3, 3, pitch=0.3125)
    scene = make_cut_outs(("repeat", "mirror"), is_nearest=True)
    drawn, cast = (next(iter(require_backend(name).render_views(scene, array, [(1, 1)]))) for name in BACKENDS)
    # Texels are 2 to 3 pixels wide; only at their edges may one or the other be taken.
    assert (np.abs(drawn.astype(int) - cast).max(-1) > 1).mean() < 0.01
    assert len(np.unique(cast[..., 0])) <= 65  # the 64 texels of a row, and nothing


@pytest.mark.parametrize("name", BACKENDS)
def test_linear_colours_are_interpolated_as_light(name):
    corners = np.array([[-20, -20, -30], [20, -20, -30], [20, 20, -30], [-20, 20, -30]], float)
    black_to_white = np.float32([[0, 0, 0, 1], [1, 1, 1, 1], [1, 1, 1, 1], [0, 0, 0, 1]])
    sheet = Part(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), black_to_white, is_linear=True)
    (picture,) = require_backend(name).render_views(Scene((sheet,)), LensArray(5, 39, 1, 1), [(0, 0)])
    expected = encode_srgb((np.arange(39) - 19) / 40 + 0.5) * 255
    assert picture[2, :, 0] == pytest.approx(expected, abs=1)


@pytest.mark.parametrize("name", BACKENDS)
def test_the_eia_holds_the_views_exactly(name):
    made = require_backend(name)
    placed = place_scene("hamburger")
    array = LensArray(20, 30, 5, 3)
    counts = []
    eia = made.render_eia(placed, array, samples=2, progress=lambda *count: counts.append(count))
    assert counts == [(done, 15) for done in range(1, 16)]
    every = [(v, u) for v in range(5) for u in range(3)]
    for (v, u), view in zip(every, made.render_views(placed, array, every, samples=2), strict=True):
        np.testing.assert_array_equal(eia[v::5, u::3], view)


@pytest.mark.parametrize("name", BACKENDS)
def test_parallax_has_the_right_sign_and_size(name):
    """A point at distance d moves by delta*d/pitch view pixels from one view to the next (design.md, Geometry)."""
    made = require_backend(name)
    placed = place_scene("vase")
    bounds = placed.bounds()
    depth = bounds[1, 2] - bounds[0, 2]
    flat = placed.transform(np.diag([1.0, 1.0, 1e-6, 1.0]))
    distance = 0.7 * depth
    matrix = np.eye(4)
    matrix[2, 3] = -distance - flat.bounds()[0, 2]
    flat = flat.transform(matrix)
    fine = replace(ARRAY, rows=400, cols=400, pitch=ARRAY.pitch / 8)  # finely sampled: the centroid to a small fraction
    centroid = {}
    for view, picture in zip(CORNERS_AND_MIDDLE, made.render_views(flat, fine, CORNERS_AND_MIDDLE), strict=True):
        ys, xs = np.nonzero(picture[..., 3])
        centroid[view] = np.array([ys.mean(), xs.mean()])
    for v, u in CORNERS_AND_MIDDLE:
        moved = centroid[v, u] - centroid[7, 7]
        step = fine.delta * distance / fine.pitch
        # As u grows the rays lean right, so what they meet lies further left among the lenses; likewise up.
        np.testing.assert_allclose(moved, [-(v - 7) * step, -(u - 7) * step], atol=0.05)


@pytest.mark.parametrize("name", BACKENDS)
def test_many_threads_at_once_get_their_own_scenes(name):
    made = require_backend(name)
    placed = {key: place_scene(key) for key in SCENES}
    expected = {key: next(made.render_views(found, ARRAY, [(3, 3)])) for key, found in placed.items()}
    wrong = []

    def ask(key):
        again = [next(made.render_views(placed[key], ARRAY, [(3, 3)])) for _ in range(3)]
        wrong.extend(key for picture in again if not np.array_equal(picture, expected[key]))

    threads = [threading.Thread(target=ask, args=(key,)) for key in list(placed) * 3]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


@pytest.mark.parametrize("name", BACKENDS)
def test_distance_does_not_matter(name):
    made = require_backend(name)
    placed = place_scene("hamburger")
    moved = np.eye(4)
    moved[2, 3] = -1e7
    (near,) = made.render_views(placed, ARRAY, [(7, 7)])
    (far,) = made.render_views(placed.transform(moved), ARRAY, [(7, 7)])
    # In float32 a surface 1e7 away would be placed to a pitch: dozens of pixels would show another.
    assert (np.abs(near.astype(int) - far).max(-1) > 3).sum() <= 1


@pytest.mark.parametrize("name", BACKENDS)
def test_background_is_where_nothing_is(name):
    made = require_backend(name)
    placed = place_scene("vase")
    (view,) = made.render_views(placed, ARRAY, [(7, 7)], background=(1, 2, 3))
    empty = view[..., 3] == 0
    assert empty.any()
    assert (view[empty][:, :3] == (1, 2, 3)).all()


@pytest.mark.parametrize("name", [*SCENES, *MESHES])
def test_depths_agree(name):
    raster, raytrace = map(require_backend, BACKENDS)
    placed = place_scene(name)
    drawn, exact = (np.stack(list(b.render_depth(placed, ARRAY, CORNERS_AND_MIDDLE))) for b in (raster, raytrace))
    hit = np.isfinite(drawn) & np.isfinite(exact)
    assert hit.any(axis=(1, 2)).all()
    error = np.abs(drawn[hit].astype(float) - exact[hit])
    # Both round vertices and depth to float32, to a few times 6e-8 of the longest side, and more on steep triangles.
    # OpenGL snaps vertices to 1/256 of a pixel: within that of an edge the two may meet different surfaces.
    longest = np.ptp(placed.bounds(), axis=0).max()
    assert np.median(error) < 1e-7 * longest
    assert (error < 2e-6 * longest).mean() > 0.995
    reach = np.pad(np.where(np.isfinite(exact), exact, np.nan), ((0, 0), (1, 1), (1, 1)), constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(reach, (3, 3), axis=(1, 2))[hit]  # (n, 3, 3)
    step = np.nanmax(around, axis=(1, 2)) - np.nanmin(around, axis=(1, 2))
    assert (error < 2e-6 * longest + step).mean() > 0.9995


@pytest.mark.parametrize("name", BACKENDS)
def test_depth_is_finite_where_colour_is_opaque(name):
    made, placed = require_backend(name), place_scene("hamburger")
    for view, depth in zip(
        made.render_views(placed, ARRAY, CORNERS_AND_MIDDLE),
        made.render_depth(placed, ARRAY, CORNERS_AND_MIDDLE),
        strict=True,
    ):
        assert (depth.dtype, depth.shape) == (np.float32, (50, 50))
        np.testing.assert_array_equal(np.isfinite(depth), view[..., 3] == 255)
        assert (depth[~np.isfinite(depth)] == np.inf).all()


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.3, -0.2), (-1.5, 0.8)])
def test_depth_of_a_plane(name, slopes):
    """z = a x + b y - 200, met along (tx, ty, -1) from (X, Y), at the depth (200 - a X - b Y) / (1 + a tx + b ty)."""
    made, (a, b) = require_backend(name), slopes
    corners = np.array([[-70.0, -70, 0], [70, -70, 0], [70, 70, 0], [-70, 70, 0]])
    corners[:, 2] = corners[:, 0] * a + corners[:, 1] * b - 200
    plane = Scene((Part(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.ones((4, 4), np.float32)),))
    x, y = np.meshgrid(ARRAY.lens_x(), ARRAY.lens_y())
    for (v, u), depth in zip(CORNERS_AND_MIDDLE, made.render_depth(plane, ARRAY, CORNERS_AND_MIDDLE), strict=True):
        expected = (200 - a * x - b * y) / (1 + a * ARRAY.tangent_x()[u] + b * ARRAY.tangent_y()[v])
        hit = np.isfinite(depth)
        assert hit.mean() > 0.3
        # float32: a few times 6e-8 of the longest side and of the depth
        np.testing.assert_allclose(depth[hit], expected[hit], atol=5e-7 * 200)


@pytest.mark.parametrize("name", BACKENDS)
def test_depth_passes_cut_outs_where_colour_does(name):
    made, array = require_backend(name), LensArray(160, 160, 3, 3, pitch=0.3125)
    near, far = make_cut_outs(("repeat", "mirror")).parts
    black = replace(far, colors=np.zeros((4, 4), np.float32), uv=None, texture=None)
    scene = Scene((near, black))
    for view in ((0, 2), (1, 1)):
        (color,), (depth,) = made.render_views(scene, array, [view]), made.render_depth(scene, array, [view])
        is_near = color[..., :3].any(axis=2)
        assert 0.2 < is_near.mean() < 0.8
        expected = np.where(is_near, 30.0, np.where(color[..., 3] > 0, 40.0, np.inf))
        np.testing.assert_allclose(depth, expected, rtol=1e-6)


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("pitch", [1e-9, 1e9])
def test_units_do_not_matter(name, pitch):
    made, found = require_backend(name), load_scene("globe")
    views, depths = [], []
    for array in (ARRAY, replace(ARRAY, pitch=pitch)):
        placed = found.transform(frame_scene(found, array))
        views += made.render_views(placed, array, [(0, 0)])
        depths += [depth / array.pitch for depth in made.render_depth(placed, array, [(0, 0)])]
    # float32 rounds differently at another scale: a sample on an edge may fall to its other side
    assert np.abs(views[0].astype(int) - views[1]).mean() < 0.1
    one, scaled = depths
    hit = np.isfinite(one) & np.isfinite(scaled)
    assert (np.abs(scaled[hit] - one[hit]) < 1e-5 * one[hit]).mean() > 0.99
