from dataclasses import replace

import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.backends import open_backend
from ciir.renderer.focus.disparity import estimate_disparity
from ciir.renderer.focus.model import make_model
from ciir.renderer.lens_array import LensArray
from ciir.renderer.light_field import LightField
from ciir.renderer.scene import Part, Scene

ARRAY = LensArray(40, 48, 5, 5, pitch=2.0, delta=0.1)
WALL, CARD = 30.0, 10.0
"""Distances: 1.5 and 0.5 pixels a view."""


def make_square(distance, half, seed):
    """A square of coloured tiles across the array's axis."""
    side = round(half / 3) + 1  # tiles of three lenses
    y, x = np.mgrid[:side, :side] / (side - 1) * 2 * half - half
    vertices = np.stack([x.ravel(), y.ravel(), np.full(side * side, -distance)], axis=1)
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate(
        [np.stack([first, first + 1, first + side], 1), np.stack([first + 1, first + side + 1, first + side], 1)]
    )
    colors = np.ones((side * side, 4), np.float32)
    colors[:, :3] = np.random.default_rng(seed).uniform(0.3, 1, (side * side, 3))
    return Part(vertices, faces.astype(np.int32), colors)


def render(scene, array=ARRAY):
    backend, _ = open_backend("raytrace", triangles=scene.triangles, rays=array.rows * array.cols, is_see_through=False)
    eia = backend.render_eia(scene, array, samples=4)[..., :3]
    return LightField.from_eia(eia, rows=array.rows, cols=array.cols)


@pytest.fixture(scope="module")
def captured():
    return render(Scene((make_square(WALL, 60, 0), make_square(CARD, 12, 1))))


@pytest.fixture(scope="module")
def model(captured):
    return make_model(captured, pitch=2.0, delta=0.1)


def test_surfaces_lie_where_they_were(model):
    distance = -model.vertices[:, 2]
    nearest = np.where(np.abs(distance - WALL) < np.abs(distance - CARD), WALL, CARD)
    # A tenth of a pixel of disparity is 2 units; the edges of the card may be worse.
    assert np.quantile(np.abs(distance - nearest), 0.9) < 2
    is_card = (nearest == CARD) & (np.abs(distance - CARD) < 2)
    assert np.abs(model.vertices[is_card, :2]).max() == pytest.approx(12, abs=2)  # within a lens
    assert not model.notes


def test_16_bits_of_which_10_are_used_have_the_colours_of_8(captured, model):
    dark = make_model(LightField(captured.views.astype(np.uint16) * 4), pitch=2.0, delta=0.1)
    np.testing.assert_allclose(dark.colors.mean(axis=0), model.colors.mean(axis=0), atol=2)


def test_it_renders_as_it_was_captured(captured, model):
    error = np.square(render(model.scene()).views.astype(float) - captured.views).mean()
    assert 10 * np.log10(255**2 / error) > 28


def test_corner_views_add_what_the_centre_does_not_see(model):
    """The card hides the wall from the centre view up to 12 units from the axis, and less of it from the corners."""
    on_wall = np.abs(model.vertices[:, 2] + WALL) < 2
    is_hidden = (np.abs(model.vertices[:, :2]) < 11).all(axis=1)
    assert (on_wall & is_hidden).sum() > 20


def test_what_only_corner_views_see_may_lie_farther():
    """A wall 35 units away, 1.75 pixels a view, is all behind a card whose tilt takes it from 5 to 25 units."""
    card = make_square(15, 24, 2)
    tilted = card.vertices + card.vertices[:, :1] * [0, 0, -10 / 24]
    array = LensArray(40, 48, 9, 9, pitch=2.0, delta=0.1)
    views = render(Scene((replace(card, vertices=tilted), make_square(35, 23, 3))), array)
    distance = -make_model(views, pitch=2.0, delta=0.1).vertices[:, 2]
    assert (np.abs(distance - 35) < 2).sum() > 100


@pytest.mark.parametrize(("most_costs", "more"), [(1 << 27, 6), (40 * 48 * 14, 2)])
def test_corner_views_are_compared_at_the_steps_of_the_centre(monkeypatch, most_costs, more):
    """However many disparities those are, and no farther than fit into memory."""
    planes = []

    def estimate(*args, **options):
        planes.append(estimate_disparity(*args, **options).planes)
        return estimate_disparity(*args, **options)

    monkeypatch.setattr("ciir.renderer.focus.disparity.MOST_PLANES", 12)
    monkeypatch.setattr("ciir.renderer.focus.disparity.MOST_COSTS", most_costs)
    monkeypatch.setattr("ciir.renderer.focus.model.model.estimate_disparity", estimate)
    array = LensArray(40, 48, 5, 5, pitch=2.0, delta=0.4)
    make_model(render(Scene((make_square(16, 12, 1), make_square(5, 6, 2))), array), pitch=2.0, delta=0.4)
    centre, *corners = planes
    assert len(corners) == 4
    for found in corners:
        np.testing.assert_array_equal(found[: len(centre)], centre)
        assert len(found) == len(centre) + more
        assert np.ptp(np.diff(found)) < 1e-9


def test_a_camera_array_gives_the_same_model_as_the_lens_array_that_shows_the_same(captured, model):
    found = make_model(captured.with_depth_sense("cameras"), pitch=2.0, delta=0.1)
    assert np.array_equal(found.vertices, model.vertices)
    (note,) = found.notes
    assert "z is in proportion to disparity" in note


def test_an_unknown_delta_is_noted_and_changes_no_view(captured):
    model = make_model(captured)
    assert model.array.delta == LensArray(40, 48, 5, 5).delta
    assert "delta" in model.notes[0]
    error = np.square(render(model.scene(), model.array).views.astype(float) - captured.views).mean()
    assert 10 * np.log10(255**2 / error) > 28


def test_background_is_left_out_unless_it_is_kept():
    views = render(Scene((make_square(CARD, 12, 1),)))
    width, kept = (
        np.ptp(make_model(views, pitch=2.0, keeps_background=keeps).vertices[:, 0]) for keeps in (False, True)
    )
    assert width == pytest.approx(24, abs=2)  # a lens
    assert kept >= ARRAY.width


def test_black_inside_an_object_is_part_of_it():
    card = make_square(CARD, 12, 1)
    colors = card.colors.copy()
    colors[(np.abs(card.vertices[:, :2]) < 7).all(axis=1), :3] = 0
    model = make_model(render(Scene((replace(card, colors=colors),))), pitch=2.0)
    backend, _ = open_backend("raytrace", triangles=len(model.faces), rays=40 * 48, is_see_through=False)
    (depth,) = backend.render_depth(model.scene(), ARRAY, [(2, 2)])
    assert np.isfinite(depth[15:25, 19:29]).all()


def test_a_black_object_is_shown_by_alpha():
    views = render(Scene((make_square(CARD, 12, 1),))).views
    black = np.zeros((*views.shape[:4], 4), np.uint8)
    black[..., 3] = 255 * (views.max(axis=4) > 0)
    model = make_model(LightField(black), pitch=2.0)
    assert np.ptp(model.vertices[:, 0]) == pytest.approx(24, abs=4)
    assert not model.colors.any()


def test_few_dark_pixels_at_the_border_are_no_background(captured):
    bright = np.maximum(captured.views, 9)
    corner = bright.copy()
    corner[0, 0, 0, 0] = 0
    counts = [len(make_model(LightField(views, depth_sense="lenses")).faces) for views in (bright, corner)]
    assert counts[1] < 1.1 * counts[0]  # each face is four where there is background


def test_views_of_nothing_are_refused():
    with pytest.raises(InvalidOption, match="nothing but background"):
        make_model(LightField(np.zeros((3, 3, 8, 8, 3), np.uint8)))
    for shape in ((3, 3, 2, 2, 3), (1, 2, 1, 5, 3)):
        with pytest.raises(InvalidOption, match="show no depth; give 4x4 or more"):
            make_model(LightField(np.zeros(shape, np.uint8)))
    with pytest.raises(InvalidOption, match="one view shows no depth"):
        make_model(LightField(np.full((1, 1, 8, 8, 3), 9, np.uint8)))
