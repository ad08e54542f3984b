"""Of what is culled no view shows anything: views stay the same to the bit, in both backends."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import BackendUnavailable
from ciir.renderer.backends import culling, open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Part, Scene
from ciir.renderer.scenes import SCENES, load_scene

ARRAY = LensArray(7, 8, 5, 5, pitch=0.5, delta=0.1)
BACKENDS = ["raytrace", "raster"]


def backend(name):
    try:
        return open_backend(name)[0]
    except BackendUnavailable as error:
        pytest.skip(str(error))


def soup(seed, *, count=2400, size=0.2, spread=2.5, depth=3.0, grazed=False):
    """Triangles of a `size` or so, in two parts, in front of the array and beside it; some without area; `grazed`: some
    whose corners stand where the rays of the middle view pass. No two are in one plane.
    """
    random = np.random.default_rng(seed)
    corners = random.uniform(-spread, spread, (count, 1, 3)) + random.normal(0, size, (count, 3, 3))
    corners[: count // 20, 2] = corners[: count // 20, 1]
    on_rays = slice(count // 20, count // 10 if grazed else 0)
    corners[on_rays, :, :2] = np.round(corners[on_rays, :, :2] * 4) / 4
    corners[..., 2] -= depth + spread + 4 * size
    colors = random.random((3 * count, 4), np.float32)
    faces, half = np.arange(3 * count, dtype=np.int32).reshape(-1, 3), count // 2
    vertices = corners.reshape(-1, 3)
    return Scene((Part(vertices, faces[:half], colors), Part(vertices, faces[half:], colors, alpha_cutoff=0.3)))


def views(name, found, array, wanted, samples=1):
    return np.stack(list(backend(name).render_views(found, array, wanted, samples=samples)))


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    st.integers(0, 999),
    st.fixed_dictionaries(
        {
            "size": st.sampled_from([1e-3, 0.05, 0.2, 1.0]),
            "spread": st.sampled_from([1.0, 2.5, 8.0]),
            "depth": st.sampled_from([0.1, 3.0, 1e4]),
        }
    ),
    st.sampled_from([[(2, 2)], [(0, 4)], [(4, 0), (0, 0)], [(0, 2), (2, 0), (2, 2), (2, 4), (4, 2)]]),
    st.sampled_from([1, 2]),
)
@pytest.mark.parametrize("name", BACKENDS)
def test_views_stay_the_same(name, seed, shape, wanted, samples):
    # Which triangle a ray exactly through an edge meets, Embree says by the order in which it keeps all triangles.
    whole = soup(seed, **shape, grazed=name == "raster")
    left = culling.cull_scene(whole, ARRAY, wanted, samples=samples)
    if left is not whole:  # some ray may meet something
        assert left.triangles < whole.triangles
        made, expected = (views(name, found, ARRAY, wanted, samples) for found in (left, whole))
        np.testing.assert_array_equal(made, expected)


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("of", SCENES)
def test_of_a_mesh_finer_than_the_lenses_little_is_left(of, name):
    array = LensArray(20, 20, 15, 15)
    whole = load_scene(of).transform(frame_scene(load_scene(of), array))
    left = culling.cull_if_worthwhile(whole, array, [(7, 7), (0, 3)], name)
    assert 0.01 < left.triangles / whole.triangles < 0.2
    np.testing.assert_array_equal(
        views(name, left, array, [(7, 7), (0, 3)]), views(name, whole, array, [(7, 7), (0, 3)])
    )


@pytest.mark.parametrize("name", BACKENDS)
def test_a_fine_sheet_with_corners_where_rays_pass_has_no_holes(name):
    y, x = (each.ravel() / 16 - 2.0 for each in np.mgrid[:65, :65])
    corner = (np.arange(64)[:, None] * 65 + np.arange(64)).ravel()
    faces = np.concatenate([corner + np.array([[0], [1], [66]]), corner + np.array([[0], [66], [65]])], axis=1).T
    vertices = np.stack([x, y, np.full(x.shape, -3.0)], axis=1)
    colors = np.stack([(x + 2) / 4, (y + 2) / 4, 0 * x, 0 * x + 1], axis=1).astype(np.float32)
    whole = Scene((Part(vertices, faces.astype(np.int32), colors),))
    left = culling.cull_if_worthwhile(whole, ARRAY, [(2, 2)], name)
    assert left.triangles < whole.triangles / 2
    made, expected = (views(name, found, ARRAY, [(2, 2)]).astype(int) for found in (left, whole))
    assert (expected[..., 3] == 255).all()
    assert np.abs(made - expected).max() <= 1  # another of the triangles around a corner, which rounds its own way


def test_of_doubled_faces_opengl_shows_the_same():
    """Embree may not: which of two surfaces at one distance it meets depends on which triangles are there."""
    first, second = soup(0).parts
    whole = Scene((first, second, replace(first, colors=1 - first.colors)))
    left = culling.cull_scene(whole, ARRAY, [(2, 2)])
    assert left.triangles < whole.triangles
    np.testing.assert_array_equal(views("raster", left, ARRAY, [(2, 2)]), views("raster", whole, ARRAY, [(2, 2)]))


def test_for_another_view_other_triangles_are_needed():
    whole = soup(0)
    left = culling.cull_if_worthwhile(whole, ARRAY, [(0, 0)], "raytrace")
    assert (views("raytrace", left, ARRAY, [(4, 4)]) != views("raytrace", whole, ARRAY, [(4, 4)])).any()


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 999), st.integers(0, 4), st.integers(0, 4), st.sampled_from([0.0, 0.03, 0.4]))
def test_a_triangle_is_met_where_its_rectangle_holds_a_ray(seed, v, u, margin):
    (part, _) = soup(seed, count=40, size=0.3).parts
    tx, ty = ARRAY.tangent_x()[u], ARRAY.tangent_y()[v]
    expected, near = [], []
    for face in part.faces:
        x, y, z = part.vertices[face].T
        across, down = x + tx * z, y + ty * z
        sides = [
            np.concatenate([lens - (some.min() - grown), (some.max() + grown) - lens])
            for some, lens, grown in (
                (across, ARRAY.lens_x(), margin * ARRAY.pitch),
                (down, ARRAY.lens_y(), margin * ARRAY.pitch),
            )
        ]
        expected.append(all((side.reshape(2, -1) >= 0).all(axis=0).any() for side in sides))
        near.append(min(np.abs(side).min() for side in sides) < 1e-5)
    found = culling.find_met_triangles(part, ARRAY, [(v, u)], margin)
    assert (found == expected)[~np.array(near)].all()  # places are float32: what just touches a ray may fall either way


def test_what_is_outside_every_view_goes():
    fine = soup(3, count=3000, size=0.05, spread=0.5)
    (first, second) = fine.parts
    beside = replace(second, vertices=second.vertices + np.array([50.0, 0, 0]))
    left = culling.cull_if_worthwhile(Scene((first, beside)), ARRAY, [(2, 2)], "raytrace")
    assert len(left.parts) == 1
    assert left.parts[0].alpha_cutoff is None
    assert len(left.parts[0].vertices) == len(np.unique(left.parts[0].faces)) < len(first.vertices)


def test_bounds_are_those_of_the_whole():
    whole = soup(5, spread=8.0)
    left = culling.cull_if_worthwhile(whole, ARRAY, [(2, 2)], "raytrace")
    np.testing.assert_array_equal(left.bounds(), whole.bounds())
    assert (replace(left, extent=None).bounds() != whole.bounds()).any()


def test_a_scene_that_no_ray_meets_stays():
    away = soup(2, spread=0.5, size=0.05).transform(np.array([[1, 0, 0, 90], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    assert culling.cull_if_worthwhile(away, ARRAY, [(2, 2)], "raytrace") is away


def test_it_pays_where_triangles_are_many_and_views_few():
    for name, few in culling.MIN_TRIANGLES_PER_RAY.items():
        assert culling.is_worthwhile(name, triangles=few * 100 * 3, rays=100, views=3)
        assert not culling.is_worthwhile(name, triangles=few * 100 * 3 - 1, rays=100, views=3)
        assert not culling.is_worthwhile(name, triangles=10**9, rays=1, views=culling.FEW_VIEWS + 1)


def test_texture_coordinates_go_with_their_vertices():
    whole = load_scene("globe").transform(frame_scene(load_scene("globe"), LensArray(9, 9, 1, 1)))
    left = culling.cull_if_worthwhile(whole, LensArray(9, 9, 1, 1), [(0, 0)], "raytrace")
    for part in left.parts:
        if part.uv is not None:
            assert len(part.uv) == len(part.vertices) == len(part.colors)


def test_sides_that_opengl_moves_onto_a_ray_are_kept(monkeypatch):
    random = np.random.default_rng(0)
    part, others = soup(0).parts
    corners = part.vertices.reshape(-1, 3, 3)
    # A side a thousandth of a pitch beside a ray, from above it to below; the third corner farther off.
    toward = np.tile([[0.0005, 0.2, 0.0], [0.0005, -0.2, 0.0], [0.2, 0.0, 0.0]], (len(corners), 1, 1))
    toward[..., 0] *= random.choice([-1, 1], (len(corners), 1))
    lenses = np.stack(
        [random.choice(ARRAY.lens_x(), len(corners)), random.choice(ARRAY.lens_y(), len(corners))], axis=1
    )
    placed = toward + np.concatenate([lenses, corners[:, 0, 2:]], axis=1)[:, None]
    whole = Scene((replace(part, vertices=placed.reshape(-1, 3)), others))
    drawn = views("raster", whole, ARRAY, [(2, 2)])
    np.testing.assert_array_equal(views("raster", culling.cull_scene(whole, ARRAY, [(2, 2)]), ARRAY, [(2, 2)]), drawn)
    monkeypatch.setattr(culling, "SNAP", 0.0)
    assert (views("raster", culling.cull_scene(whole, ARRAY, [(2, 2)]), ARRAY, [(2, 2)]) != drawn).any()
