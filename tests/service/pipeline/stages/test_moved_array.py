"""Pictures of a mesh's view through a lens array that is moved: where they are sampled, and what they gain."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.models.light_field import views
from ciir.models.light_field.disparities.ranges import estimate_tiles
from ciir.models.light_field.disparities.shifts import crop_luma
from ciir.models.light_field.windows import WINDOW_SIDE, list_window
from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene
from ciir.service.pipeline import job
from ciir.service.pipeline.planning.plan import make_plan
from ciir.service.pipeline.report import Clock
from ciir.service.pipeline.stages import moved_array
from ciir.service.pipeline.stages.view_sources import MeshViews
from tests.support.pipeline import make_mesh_job, run

COUNTS = st.integers(1, 9)


@settings(max_examples=60)
@given(rows=COUNTS, cols=COUNTS, pitch=st.floats(0.1, 10), view=st.tuples(st.integers(0, 5), st.integers(0, 5)))
def test_each_picture_is_sampled_through_lenses_at_its_own_position(rows, cols, pitch, view):
    """The lenses stand two fifths of a pitch further to the right, or down, from one picture to the next."""
    array = LensArray(rows, cols, 6, 6, pitch, 0.02)
    fine = moved_array.refine_array(array)
    assert fine.rows * fine.cols == moved_array.count_samples(array, 1) == moved_array.count_samples(array, 4) / 4
    x, y = np.meshgrid(fine.lens_x(), fine.lens_y())
    pictures = dict(moved_array.split_cells(np.stack([x, y], axis=2), view, averages=False))
    window = list_window(moved_array.find_place(view), moved_array.list_grid((6, 6)))
    assert [place for place, _ in window] == list(pictures)
    for place, (down, right) in window:
        assert moved_array.find_view(place) == view
        expected = np.meshgrid(array.lens_x() + 0.4 * right * pitch, array.lens_y() - 0.4 * down * pitch)
        np.testing.assert_allclose(pictures[place], np.stack(expected, axis=2), rtol=0, atol=1e-9 * pitch)


@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_lenslets_average_their_cells(rows, cols, seed):
    shape = WINDOW_SIDE * (rows + 2), WINDOW_SIDE * (cols + 2), 3
    samples = np.random.default_rng(seed).integers(0, 256, shape, np.uint8)
    for (v, u), picture in moved_array.split_cells(samples, (0, 0), averages=True):
        assert picture.shape == (rows, cols, 3)
        for y, x in np.ndindex(rows, cols):
            top, left = 5 * (y + 1) + 2 * (v - 2), 5 * (x + 1) + 2 * (u - 2)
            mean = samples[top : top + 5, left : left + 5].astype(float).mean(axis=(0, 1))
            assert np.abs(picture[y, x] - mean).max() <= 0.5


def test_each_view_is_sampled_once_and_when_its_first_picture_is_taken():
    """Pictures of two views in one row of views come in turn, row by row of their windows."""
    wanted = [(0, 0), (0, 1), (2, 1)]
    places = sorted(place for view in wanted for place, _ in list_window(moved_array.find_place(view), (15, 10)))
    rendered = (np.full((15, 20, 3), number, np.uint8) for number in range(len(wanted)))
    taken = list(moved_array.take_pictures(rendered, places, averages=False))
    assert [wanted[int(picture[0, 0, 0])] for picture in taken] == [moved_array.find_view(place) for place in places]
    assert next(rendered, None) is None


@pytest.mark.parametrize("samples", [1, 4])
def test_the_picture_in_the_middle_is_the_view(samples):
    """A pinhole's luma is to rounding; a lenslet's mean is of 10x10 samples, in the lens array's own view of 4x4."""
    mesh, array = load_scene("vase"), LensArray(40, 40, 5, 5)
    placed, backend, view = mesh.transform(frame_scene(mesh, array)), RaytraceBackend(), (1, 3)
    (own,) = backend.render_views(placed, array, [view], samples=samples)
    fine = backend.render_views(
        placed, moved_array.refine_array(array), [view], samples=moved_array.find_cell_side(samples)
    )
    (made,) = moved_array.take_pictures(fine, [moved_array.find_place(view)], averages=samples > 1)
    difference = 255 * np.abs(crop_luma(made[..., :3]) - crop_luma(own[..., :3]))
    assert difference.mean() < (0.3 if samples == 1 else 1.5)


def test_the_colours_of_pinholes_are_means_and_grey_stays_grey():
    samples = np.random.default_rng(0).integers(60, 190, (25, 30, 3), np.uint8)
    made = moved_array.average_colours(samples)
    for y, x in np.ndindex(3, 4):
        top, left = 5 * (y + 1), 5 * (x + 1)
        mean, middle = samples[top : top + 5, left : left + 5].mean(axis=(0, 1)), samples[top + 2, left + 2]
        expected = mean + (middle - mean) @ (0.299, 0.587, 0.114)
        assert np.abs(made[y, x] - expected).max() < 1.1  # two roundings
    grey = np.repeat(samples[..., :1], 3, axis=2)
    np.testing.assert_array_equal(moved_array.average_colours(grey), grey[7:-5:5, 7:-5:5])


def test_all_content_has_the_disparity_that_the_network_is_given():
    """As it is measured in the pictures; near and far sides of the globe move alike."""
    mesh, array = load_scene("globe"), LensArray(64, 64, 9, 9)
    placed = mesh.transform(frame_scene(mesh, array))
    grid, at = moved_array.list_grid((9, 9)), moved_array.find_place((4, 1))
    places = [place for place, _ in list_window(at, grid)]
    fine = RaytraceBackend().render_views(placed, moved_array.refine_array(array), [(4, 1)])
    pictures = moved_array.take_pictures(fine, places, averages=True)
    lumas = {place: crop_luma(picture[..., :3]) for place, picture in zip(places, pictures, strict=True)}
    ((found, misalignment),) = estimate_tiles(lumas, [at], grid, np.indices((8, 8)).reshape(2, -1), [np.zeros(64, int)])
    assert len(found) > 10
    assert moved_array.DISPARITIES == (-0.4, -0.4)
    assert abs(np.median(found) + 0.4) < 0.02
    assert misalignment < 0.03


def test_renderings_of_too_many_samples_are_not_possible():
    array = LensArray(798, 798, 5, 5)
    assert moved_array.count_samples(array, 1) == moved_array.MOST_SAMPLES
    assert moved_array.is_possible(array, 1)
    assert not moved_array.is_possible(replace(array, cols=799), 1)
    for cols, lens_side, is_possible in ((1636, 1, True), (1637, 1, False), (817, 4, True), (818, 4, False)):
        assert moved_array.is_possible(replace(array, rows=1, cols=cols), lens_side) == is_possible  # 8190, 8195, 8200


@pytest.mark.parametrize("sampling", ["pinhole", "lenslet"])
def test_they_bring_a_view_closer_to_the_truth(sampling):
    """By 2 dB and 0.4 dB here (docs/experiments.md): the lens array's other views see around the vase."""
    options = {"lenses": (100, 100), "backend": "raytrace", "model": "field", "sampling": sampling}
    truth, _ = run("vase", **options | {"model": "auto", "strategy": "direct"})
    errors = []
    for bound, words in (
        (0.0, "views around those asked for are rendered too, 24"),
        (60.0, "each view is rendered through the lens array at 5x5 positions"),
    ):
        made, report = run("vase", **options, neighbour_time=bound)
        assert words in report["plan"]["reasons"][0]
        errors.append(np.square(made[7, 7].astype(float) - truth[7, 7]).mean())
    assert errors[1] < (0.7 if sampling == "pinhole" else 0.95) * errors[0]


def test_mean_colours_bring_a_pinhole_view_closer_to_the_truth(monkeypatch):
    """By 2 dB in RGB here: the globe's colours are finer than its luma alone can tell."""
    options = {"lenses": (60, 60), "backend": "raytrace", "model": "field"}
    truth, _ = run("globe", **options | {"model": "auto", "strategy": "direct"})
    errors = []
    for colours in (moved_array.average_colours, lambda cells: cells[7:-5:5, 7:-5:5]):
        monkeypatch.setattr(moved_array, "average_colours", colours)
        made, _ = run("globe", **options)
        errors.append(np.square(made[7, 7].astype(float) - truth[7, 7]).mean())
    assert errors[0] < 0.85 * errors[1]


def test_the_network_is_given_the_disparity(monkeypatch):
    given_disparities = []
    upscale = views.upscale_views

    def spy(*given, disparities, **options):
        given_disparities.append(disparities)
        return upscale(*given, disparities=disparities, **options)

    monkeypatch.setattr(views, "upscale_views", spy)
    for bound in (60.0, 0.0):
        run("vase", lenses=(12, 10), model="field", backend="raytrace", neighbour_time=bound)
    assert given_disparities == [moved_array.DISPARITIES, None]


@pytest.mark.parametrize("sampling", ["pinhole", "lenslet"])
def test_the_backend_is_that_of_the_views_themselves(sampling):
    """So few rays that they are cast, but many more samples through a moved lens array."""
    reports = [
        run("vase", lenses=(24, 24), sampling=sampling, model=model, neighbour_time=60.0)[1]
        for model in ("field", "none")
    ]
    assert [report["plan"]["backend"] for report in reports] == ["raytrace", "raytrace"]
    assert "at 5x5 positions" in reports[0]["plan"]["reasons"][0]


def test_the_samples_of_all_pictures_are_those_of_the_rendering():
    wanted = make_mesh_job(lenses=(30, 20), model="field", neighbour_time=60.0)
    plan = make_plan(wanted)
    assert plan.moves_array
    source = MeshViews(wanted.mesh, wanted, plan, Clock())
    assert source.samples * moved_array.PICTURES == moved_array.count_samples(wanted.array, wanted.samples)


def test_a_view_does_not_depend_on_the_others_that_are_wanted():
    options = {"lenses": (60, 60), "pixels": (5, 5), "backend": "raytrace", "model": "field", "neighbour_time": 60.0}
    several, report = run("vase", **options, views="0,0;2,2;4,1")
    assert [(view["v"], view["u"]) for view in report["views"]] == list(several) == [(0, 0), (2, 2), (4, 1)]
    for view, picture in several.items():
        alone, _ = run("vase", **options, views="{},{}".format(*view))
        np.testing.assert_array_equal(alone[view], picture)


def test_the_mesh_is_framed_once(monkeypatch):
    framed = []
    monkeypatch.setattr(job, "frame_scene", lambda *given: framed.append(given) or frame_scene(*given))
    _, report = run("vase", lenses=(12, 10), model="field", backend="raytrace")
    assert any("at 5x5 positions" in reason for reason in report["plan"]["reasons"])
    assert len(framed) == 1
