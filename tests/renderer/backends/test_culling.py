"""Culling removes only triangles that no view shows: views stay the same to the bit, in both backends."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.renderer.backends import culling
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Part, Scene
from ciir.renderer.scenes import SCENES
from tests.support.backends import BACKENDS, place_scene, require_backend

ARRAY = LensArray(7, 8, 5, 5, pitch=0.5, delta=0.1)


def make_soup(seed, *, count=2400, size=0.2, spread=2.5, depth=3.0, grazed=False):
    """Triangles of about `size`, in two parts, in front of the array and beside it; some have no area. With `grazed`
    some have corners on rays of the middle view. No two are in one plane.
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


def render(name, scene, array, views, samples=1):
    return np.stack(list(require_backend(name).render_views(scene, array, views, samples=samples)))


@settings(max_examples=25)
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
def test_views_stay_the_same(name, seed, shape, views, samples):
    # Which triangle Embree finds on a ray exactly through an edge depends on the order of all triangles.
    whole = make_soup(seed, **shape, grazed=name == "raster")
    culled = culling.cull_scene(whole, ARRAY, views, samples=samples)
    if culled is not whole:  # some ray may meet something
        assert culled.triangles < whole.triangles
        made, expected = (render(name, found, ARRAY, views, samples) for found in (culled, whole))
        np.testing.assert_array_equal(made, expected)


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("scene", SCENES)
def test_most_triangles_finer_than_the_lenses_are_removed(scene, name):
    array, views, made = LensArray(20, 20, 15, 15), [(7, 7), (0, 3)], require_backend(name)
    whole = place_scene(scene, array)
    culled = culling.cull_if_worthwhile(whole, array, views, name)
    assert 0.01 < culled.triangles / whole.triangles < 0.2
    np.testing.assert_array_equal(render(name, culled, array, views), render(name, whole, array, views))
    for depth, expected in zip(*(made.render_depth(found, array, views) for found in (culled, whole)), strict=True):
        np.testing.assert_array_equal(depth, expected)


@pytest.mark.parametrize("name", BACKENDS)
def test_a_fine_sheet_with_corners_on_rays_has_no_holes(name):
    y, x = (each.ravel() / 16 - 2.0 for each in np.mgrid[:65, :65])
    corner = (np.arange(64)[:, None] * 65 + np.arange(64)).ravel()
    faces = np.concatenate([corner + np.array([[0], [1], [66]]), corner + np.array([[0], [66], [65]])], axis=1).T
    vertices = np.stack([x, y, np.full(x.shape, -3.0)], axis=1)
    colors = np.stack([(x + 2) / 4, (y + 2) / 4, 0 * x, 0 * x + 1], axis=1).astype(np.float32)
    whole = Scene((Part(vertices, faces.astype(np.int32), colors),))
    culled = culling.cull_if_worthwhile(whole, ARRAY, [(2, 2)], name)
    assert culled.triangles < whole.triangles / 2
    made, expected = (render(name, found, ARRAY, [(2, 2)]).astype(int) for found in (culled, whole))
    assert (expected[..., 3] == 255).all()
    assert np.abs(made - expected).max() <= 1  # another triangle around a corner may round differently


def test_opengl_draws_doubled_faces_the_same():
    """Embree may not: which of two surfaces at one distance it finds depends on all triangles."""
    first, second = make_soup(0).parts
    whole = Scene((first, second, replace(first, colors=1 - first.colors)))
    culled = culling.cull_scene(whole, ARRAY, [(2, 2)])
    assert culled.triangles < whole.triangles
    np.testing.assert_array_equal(render("raster", culled, ARRAY, [(2, 2)]), render("raster", whole, ARRAY, [(2, 2)]))


def test_triangles_outside_every_view_are_removed():
    fine = make_soup(3, count=3000, size=0.05, spread=0.5)
    (first, second) = fine.parts
    beside = replace(second, vertices=second.vertices + np.array([50.0, 0, 0]))
    culled = culling.cull_if_worthwhile(Scene((first, beside)), ARRAY, [(2, 2)], "raytrace")
    assert len(culled.parts) == 1
    assert culled.parts[0].alpha_cutoff is None
    assert len(culled.parts[0].vertices) == len(np.unique(culled.parts[0].faces)) < len(first.vertices)


def test_a_scene_that_no_ray_meets_stays():
    away = make_soup(2, spread=0.5, size=0.05).transform(
        np.array([[1, 0, 0, 90], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    )
    assert culling.cull_if_worthwhile(away, ARRAY, [(2, 2)], "raytrace") is away


def test_culling_is_worthwhile_for_many_triangles_and_few_views():
    for name, few in culling.MIN_TRIANGLES_PER_RAY.items():
        assert culling.is_worthwhile(name, triangles=few * 100 * 3, rays=100, views=3)
        assert not culling.is_worthwhile(name, triangles=few * 100 * 3 - 1, rays=100, views=3)
        assert not culling.is_worthwhile(name, triangles=10**9, rays=1, views=culling.FEW_VIEWS + 1)


def test_edges_that_opengl_snaps_onto_a_ray_are_kept(monkeypatch):
    random = np.random.default_rng(0)
    part, others = make_soup(0).parts
    corners = part.vertices.reshape(-1, 3, 3)
    # An edge a thousandth of a pitch beside a ray, from above it to below; the third corner farther away.
    toward = np.tile([[0.0005, 0.2, 0.0], [0.0005, -0.2, 0.0], [0.2, 0.0, 0.0]], (len(corners), 1, 1))
    toward[..., 0] *= random.choice([-1, 1], (len(corners), 1))
    lenses = np.stack(
        [random.choice(ARRAY.lens_x(), len(corners)), random.choice(ARRAY.lens_y(), len(corners))], axis=1
    )
    placed = toward + np.concatenate([lenses, corners[:, 0, 2:]], axis=1)[:, None]
    whole = Scene((replace(part, vertices=placed.reshape(-1, 3)), others))
    drawn = render("raster", whole, ARRAY, [(2, 2)])
    np.testing.assert_array_equal(render("raster", culling.cull_scene(whole, ARRAY, [(2, 2)]), ARRAY, [(2, 2)]), drawn)
    monkeypatch.setattr(culling, "SNAP", 0.0)
    assert (render("raster", culling.cull_scene(whole, ARRAY, [(2, 2)]), ARRAY, [(2, 2)]) != drawn).any()
