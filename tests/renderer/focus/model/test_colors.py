import numpy as np
import pytest

from ciir.renderer.backends import open_backend
from ciir.renderer.focus.model.colors import fit_colors
from ciir.renderer.lens_array import LensArray
from ciir.renderer.light_field import LightField
from ciir.renderer.scene import Part, Scene

ARRAY = LensArray(24, 24, 3, 3, delta=0.1)


def make_wall(colors):
    """9x9 vertices, two lenses apart, 15 behind the array, and one that no triangle uses; colours `(82, 3)`."""
    y, x = np.mgrid[:9, :9]
    vertices = np.stack([2.0 * x.ravel() - 8, 2.0 * y.ravel() - 8, np.full(81, -15.0)], axis=1)
    first = (9 * y[:8, :8] + x[:8, :8]).ravel()
    faces = np.concatenate([first[:, None] + [0, 1, 9], first[:, None] + [1, 10, 9]]).astype(np.int32)
    rgba = np.pad(colors / np.float32(255), ((0, 0), (0, 1)), constant_values=1).astype(np.float32)
    return Scene((Part(np.concatenate([vertices, [[0, 0, -15.0]]]), faces, rgba),))


@pytest.fixture(scope="module")
def true():
    return np.random.default_rng(0).integers(40, 215, (82, 3))


@pytest.fixture(scope="module")
def field(true):
    backend, _ = open_backend("raytrace", triangles=128, rays=576, is_see_through=False)
    eia = backend.render_eia(make_wall(true), ARRAY, samples=1)[..., :3]
    return LightField.from_eia(eia, rows=24, cols=24)


def test_the_colours_that_the_views_show_are_found(true, field):
    wrong = np.clip(true + np.random.default_rng(1).integers(-40, 41, true.shape), 0, 255)
    found = fit_colors(make_wall(wrong), field, ARRAY)
    assert np.abs(wrong - true)[:81].mean() > 15
    assert np.abs(found - true)[:81].mean() < 4  # what is damped remains


def test_a_vertex_that_no_ray_meets_keeps_its_colour(true, field):
    wrong = true.copy()
    wrong[81] = 7
    assert fit_colors(make_wall(wrong), field, ARRAY)[81] == pytest.approx(7, abs=1e-3)


def test_grey_views_give_one_channel(true, field):
    grey = LightField(field.views[..., :1])
    assert fit_colors(make_wall(true), grey, ARRAY).shape == (82, 1)


def test_pixels_beside_background_do_not_count_with_skips_rim(true, field):
    """Lenses there average the wall, vertices 0 and 80 of which are corners, with what is behind it."""
    rim = np.zeros((24, 24), bool)
    rim[[3, 4, 19, 20]] = rim[:, [3, 4, 19, 20]] = True
    dark = LightField(np.where(rim[..., None], 0, field.views).astype(np.uint8))
    kept, skipped = (fit_colors(make_wall(true), dark, ARRAY, skips_rim=skips) for skips in (False, True))
    assert np.abs(kept - true)[0].mean() > 20
    np.testing.assert_allclose(skipped[0], true[0], atol=1)
