from dataclasses import replace

import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.backends import open_backend
from ciir.renderer.light_field import LightField
from ciir.renderer.scene import Part, Scene
from ciir.service.pipeline.focus.disparities import find_disparity
from ciir.service.pipeline.focus.models import NO_BACKGROUND, SEE_THROUGH, build_model
from ciir.service.pipeline.options import KINDS
from tests.support.light_fields import make_views

MESH = {"lenses": "24x24", "pixels": "5x5", "backend": "raytrace", "pitch": "0.5", "delta": "0.1"}


def build(source, **texts):
    return build_model(source, KINDS["disparity"].parse(texts))


def test_it_has_the_lens_array_of_the_input():
    model, report = build("vase", **MESH)
    assert (model.array.pitch, model.array.delta, model.array.rows) == (0.5, 0.1, 24)
    assert report["surface"] == {"vertices": len(model.vertices), "triangles": len(model.faces)}
    assert report["notes"] == []
    assert {"render", "focus", "total"} <= set(report["timings_ms"])


def test_the_model_of_a_mesh_has_its_exact_depths():
    found, _ = find_disparity("vase", KINDS["disparity"].parse(MESH))
    model, _ = build("vase", **MESH)
    backend, _ = open_backend("raytrace", triangles=len(model.faces), rays=24 * 24, is_see_through=False)
    (depth,) = backend.render_depth(model.scene(), model.array, [found.view])
    is_seen, is_there = found.confidence > 0, np.isfinite(depth)
    assert np.mean(is_seen != is_there) < 0.03  # outlines are right to a quarter of a pixel
    error = np.abs(depth * (model.array.delta / model.array.pitch) - found.disparity)[is_seen & is_there]
    assert np.quantile(error, 0.95) < 0.05


def test_the_model_of_a_mesh_is_the_same_on_any_background():
    black, _ = build("vase", **MESH)
    blue, report = build("vase", **MESH, background="8080ff")
    for name in ("vertices", "colors", "faces"):
        np.testing.assert_array_equal(getattr(blue, name), getattr(black, name))
    assert report["notes"] == [NO_BACKGROUND]


def make_card(rgba, **material):
    """A square across the axis of the lens array."""
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Part(vertices, faces, np.tile(np.float32(rgba), (4, 1)), **material)


def test_progress_goes_on_while_the_model_is_made():
    steps = []
    build_model("vase", KINDS["disparity"].parse(MESH), progress=lambda *step: steps.append(step))
    done, totals = zip(*steps, strict=True)
    assert set(totals) == {2 * 25}
    assert list(done) == sorted(done)
    assert done[-1] == 50
    assert sum(number > 25 for number in set(done)) == 5  # the centre view and the corners


def test_a_black_mesh_has_a_model():
    model, report = build(Scene((make_card((0, 0, 0, 1)),)), **MESH)
    assert not model.colors.any()
    assert len(model.faces) > 100
    assert report["notes"] == []


def test_the_see_through_parts_of_a_mesh_are_left_out_with_a_note():
    glass = make_card((1, 0, 0, 0.3), is_see_through=True)
    wall = make_card((0, 1, 0, 1))
    behind = replace(wall, vertices=wall.vertices - [0, 0, 1])
    model, report = build(Scene((glass, behind)), **MESH)
    assert np.ptp(model.vertices[:, 2]) < 0.01
    assert report["notes"] == [SEE_THROUGH]
    with pytest.raises(InvalidOption, match=r"alpha of 0\.5 or more; give .* its elemental image array"):
        build(Scene((glass,)), **MESH)


def test_after_upscaling_it_lies_where_it_did():
    small, _ = build("vase", **MESH)
    large, _ = build("vase", **MESH, model="nearest")
    assert (large.array.rows, large.array.pitch) == (48, 0.25)
    # Pixels of 0.5 and 0.25; the median of depths is not moved by outliers at outlines.
    np.testing.assert_allclose(np.median(large.vertices, axis=0), np.median(small.vertices, axis=0), atol=0.5)


@pytest.mark.parametrize("name", ["view", "limits"])
def test_options_of_maps_are_refused(name):
    with pytest.raises(InvalidOption, match=f"{name}: a model is made of several views"):
        build(LightField(np.zeros((3, 3, 8, 8, 3), np.uint8)), **{name: {"view": "0,0", "limits": "0:1"}[name]})


def make_wall():
    """5x5 cameras before a wall with a disparity of 2 pixels."""
    return LightField(make_views(side=64, disparities=(-2, -2)), is_ordered=True, depth_sense="cameras")


@pytest.mark.parametrize("sense", ["cameras", "lenses"])
@pytest.mark.parametrize("model", ["none", "nearest"])
def test_the_depth_of_a_camera_array_is_true_also_after_upscaling(model, sense):
    cameras = {"camera_pitch": "2", "focal_length": "36", "sensor": "36"}  # 128 / depth pixels
    built, report = build(make_wall().with_depth_sense(sense), **cameras, model=model)
    assert not any("disparity" in note for note in report["notes"])
    assert np.median(built.vertices[:, 2]) == pytest.approx(-64, rel=0.01)
    np.testing.assert_allclose(np.ptp(built.vertices[:, :2], axis=0), 64 + 8, atol=0.5)  # the corners see 4 mm more


def test_a_camera_array_of_unknown_geometry_is_noted():
    _, report = build(make_wall())
    assert "z is in proportion to disparity" in report["notes"][-1]


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ({"camera_pitch": "2"}, "camera_pitch: depths need focal_length and sensor too"),
        ({"convergence": "2"}, "convergence: this needs camera_pitch"),
    ],
)
def test_the_geometry_of_cameras_is_complete(texts, message):
    with pytest.raises(InvalidOption, match=message):
        build(make_wall(), **texts)


def test_a_lens_array_has_no_cameras():
    with pytest.raises(InvalidOption, match="camera_pitch: this is for camera arrays"):
        build("vase", **MESH, camera_pitch="2", focal_length="36", sensor="36")
