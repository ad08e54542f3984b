import numpy as np
import pytest

from ciir.errors import InvalidOption, TooLarge
from ciir.renderer.focus import planes as library
from ciir.renderer.levels import round_levels
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.service.pipeline.focus.planes import refocus
from ciir.service.pipeline.options import KINDS

LENSES = LightField(np.random.default_rng(0).integers(0, 256, (3, 4, 16, 20, 3), np.uint8), is_ordered=True)
CAMERAS = LightField(LENSES.views, is_ordered=True, depth_sense="cameras")
CAMERA_ARRAY = {"camera_pitch": "2", "focal_length": "36", "sensor": "36"}
"""20 pixels across: 40 / depth pixels a view."""


def run(source, **texts):
    """The planes `(n, H, W, C)`, the stack and the report."""
    kept = []

    def write(stack):
        kept.extend([np.stack(list(stack.read())), stack])
        return ["written"]

    report = refocus(source, KINDS["plane"].parse(texts), write)
    return *kept, report


def test_a_stack_is_that_of_the_library():
    planes, stack, report = run(CAMERAS, stack="-1:1.5:6", method="window", aperture="1.5", aperture_shape="square")
    weights = np.array([[0.5, 1, 1, 0.5]] * 3, np.float32)
    expected = np.stack(list(library.refocus(CAMERAS.views, np.linspace(-1, 1.5, 6), method="window", weights=weights)))
    np.testing.assert_allclose(planes, expected, atol=1e-3)
    assert stack.names[:2] == ("plane_000_d-1.000", "plane_001_d-0.500")
    assert [plane["disparity"] for plane in report["planes"]] == pytest.approx([-1, -0.5, 0, 0.5, 1, 1.5])
    assert (report["method"], report["depth_unit"], report["notes"]) == ("window", None, ["written"])
    assert {"focus", "encode", "total"} <= set(report["timings_ms"])


@pytest.mark.parametrize(
    ("model", "given", "count"),
    [
        ("nearest", {"aperture": "1"}, 6),
        ("field", {"aperture": "0.6"}, 2),
        ("nearest", {"aperture": "1", "aperture_shape": "gauss"}, 12),
        ("nearest", {"aperture": "1", "all_in_focus": "yes"}, 12),
        ("none", {"aperture": "1"}, 12),
    ],
)
def test_views_beyond_the_aperture_are_not_upscaled(monkeypatch, model, given, count):
    steps = []

    def make():
        kept, texts = [], {"model": model, **({} if "all_in_focus" in given else {"disparity": "0.5"}), **given}
        options, progress = KINDS["plane"].parse(texts), lambda done, total: steps.append((done, total))
        refocus(CAMERAS, options, lambda stack: kept.extend(stack.read()) or [], progress=progress)
        return kept

    some = make()
    assert steps[-1] == (count + 1, count + 1)
    monkeypatch.setattr("ciir.service.pipeline.focus.light_fields._select_views", lambda source, options: "all")
    np.testing.assert_array_equal(some, make())


def test_larger_is_nearer_with_both_depth_senses():
    lenses, _, report = run(LENSES, disparity="1.25")
    np.testing.assert_allclose(lenses[0], next(library.refocus(LENSES.views, [-1.25])), atol=1e-3)
    assert "over 0 lie in front of the lens array" in report["notes"][0]
    cameras, _, report = run(CAMERAS, disparity="1.25")
    np.testing.assert_allclose(cameras[0], next(library.refocus(LENSES.views, [1.25])), atol=1e-3)
    assert report["notes"] == ["written"]


@pytest.mark.parametrize(
    ("given", "side"),
    [
        ({"disparity": "0.5"}, "disparities over 0"),
        ({"depth": "-10"}, "depths below 0"),
        ({"disparity": "-0.5"}, None),
        ({"depth": "10"}, None),
        ({"disparity": "0.5", "place": "-1"}, "disparities over 0"),
        ({"disparity": "0.5", "place": "0"}, None),
        ({"disparity": "0.5", "fit": "none"}, None),
    ],
)
def test_planes_in_front_of_the_lens_array_are_noted_unless_the_mesh_may_be_there(given, side):
    report = run("vase", lenses="8x8", pixels="3x3", backend="raytrace", **given)[-1]
    noted = [note for note in report["notes"] if "in front of the lens array" in note]
    assert len(noted) == (side is not None)
    assert all(note.startswith(side) for note in noted)


def test_a_set_of_views_may_be_of_cameras_with_either_depth_sense(tmp_path):
    """So that nothing is said of the front of a lens array."""
    LENSES.save(tmp_path / "views")
    _, _, report = run(Bundle.from_path(tmp_path / "views"), disparity="1.25")
    assert report["lens_array"]["depth_sense"] == "lenses"
    assert not any("lens array" in note for note in report["notes"])


def test_depths_before_cameras_are_in_millimetres():
    planes, stack, report = run(CAMERAS, stack="20:40:2", stack_of="depths", **CAMERA_ARRAY)
    np.testing.assert_allclose(planes, np.stack(list(library.refocus(CAMERAS.views, [2, 1]))), atol=1e-3)
    assert (stack.kind, stack.names) == ("depths", ("plane_000_z20mm", "plane_001_z40mm"))
    assert [(plane["disparity"], plane["depth"]) for plane in report["planes"]] == [(2, 20), (1, 40)]
    _, _, report = run(CAMERAS, depth="40", convergence="40", **CAMERA_ARRAY)
    assert report["planes"][0]["disparity"] == pytest.approx(0)


def test_a_mesh_is_rendered_and_its_depths_are_in_scene_units():
    given = {"lenses": "12x12", "pixels": "3x3", "pitch": "0.5", "delta": "0.1", "backend": "raytrace"}
    _, stack, report = run("vase", depth="5", **given)
    assert stack.names == ("plane_000_z5",)
    assert report["planes"] == [{"name": "plane_000_z5", "disparity": pytest.approx(-1), "depth": pytest.approx(5)}]
    assert report["depth_unit"] == "scene units"


def test_after_upscaling_the_same_options_show_the_same_depth():
    planes, stack, report = run(CAMERAS, stack="0:0.5:2", model="nearest", scale="2")
    assert stack.shape == (32, 40, 3)
    large = CAMERAS.views.repeat(2, axis=2).repeat(2, axis=3)
    np.testing.assert_allclose(planes, np.stack(list(library.refocus(large, [0, 1]))), atol=1e-3)
    assert report["planes"][1]["disparity"] == 0.5
    assert "planes have 2 pixels for each" in report["notes"][0]


def test_all_in_focus_is_that_of_the_library():
    views, stack, report = run(LENSES, all_in_focus="yes", aperture="1", limits="-1:0.5")
    found = LENSES.disparity(limits=(-0.5, 1))  # a lens array's own sense is the other one
    np.testing.assert_array_equal(round_levels(views[0], stack.dtype), LENSES.all_in_focus(found, aperture=1))
    assert report["planes"] == [{"name": "all_in_focus"}]


def test_occluders_are_removed():
    planes, _, _ = run(CAMERAS, disparity="1", occluders="remove")
    np.testing.assert_array_equal(round_levels(planes[0], np.dtype("u1")), CAMERAS.refocus(1.0, occluders="remove"))


def test_planes_are_in_the_units_of_the_views():
    wide = LightField(LENSES.views.astype(np.uint16) * 257, is_ordered=True)
    planes, stack, _ = run(wide, disparity="0")
    assert stack.dtype == np.uint16
    np.testing.assert_array_equal(round_levels(planes[0], stack.dtype), wide.refocus(0.0))


def test_unused_bits_are_those_of_all_views():
    views = np.full((3, 3, 8, 8, 1), 1000, np.uint16)
    views[0, 0, 0, 0] = 4000
    _, stack, _ = run(LightField(views), stack="-1:1:3")
    assert stack.unused == 4


def test_progress_counts_views_and_planes():
    seen = []
    refocus(
        CAMERAS,
        KINDS["plane"].parse({"stack": "0:1:3"}),
        lambda stack: [str(len(list(stack.read())))],
        progress=lambda *counts: seen.append(counts),
    )
    assert seen[0] == (0, 15)
    assert seen[-4:] == [(12, 15), (13, 15), (14, 15), (15, 15)]


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ({}, "no plane is asked for; give one of disparity, depth, stack and all"),
        ({"disparity": "0", "stack": "0:1:3"}, "disparity, stack: these ask for different pictures"),
        ({"stack": "1:1:3"}, "3 planes from 1 to 1 make no stack"),
        ({"stack": "0:1:1"}, "give 2 to 1024 planes"),
        ({"stack": "0:1:1025"}, "give 2 to 1024 planes"),
        ({"depth": "5"}, "the geometry of light field is unknown; give pitch and delta"),
        ({"depth": "5", "camera_pitch": "2"}, "camera_pitch: depths need focal_length and sensor too"),
        ({"depth": "5", "sensor": "2"}, "sensor: this needs camera_pitch"),
        ({"depth": "5", "camera_pitch": "2", "focal_length": "36"}, "camera_pitch: depths need focal_length and"),
        ({"depth": "-5", **CAMERA_ARRAY}, "-5 mm is not in front of the cameras"),
        ({"disparity": "1", **CAMERA_ARRAY}, "camera_pitch: this is for depths"),
        ({"disparity": "1", "stack_of": "depths"}, "stack_of: this needs stack"),
        ({"disparity": "1", "aperture_shape": "gauss"}, "aperture_shape: this needs aperture"),
        (
            {"disparity": "1", "occluders": "remove", "method": "delta"},
            "occluders: they are not removed with the method",
        ),
        ({"disparity": "21"}, "disparity: 21 pixels are over the 20 of a view"),
        ({"depth": "1e-9", **CAMERA_ARRAY}, "disparity: 4e.10 pixels are over the 20 of a view"),
        ({"disparity": "1", "limits": "0:1"}, "limits: this is for all_in_focus"),
        ({"all_in_focus": "yes", "disparity": "1"}, "disparity, all_in_focus: these ask for different pictures"),
        ({"all_in_focus": "yes", "method": "delta"}, "method: this is for planes"),
        ({"all_in_focus": "yes", "limits": "1:0"}, "limits: 1:0 is not a range"),
        ({"disparity": "1", "aperture": "0.1", "aperture_shape": "square"}, None),
    ],
)
def test_what_is_asked_for_must_fit(texts, message):
    if message is None:
        run(LightField(LENSES.views[:, :3], is_ordered=True), **texts)
        return
    with pytest.raises(InvalidOption, match=message):
        run(CAMERAS, **texts)


def test_cameras_may_be_counted_from_the_other_end():
    """Views that are ordered like those of a lens array may be a camera array's, as Stanford's are."""
    cameras = CAMERAS[:, :3]  # a grid with a middle view
    planes, _, report = run(cameras.with_depth_sense("lenses"), depth="40", **CAMERA_ARRAY)
    np.testing.assert_allclose(planes, run(cameras, depth="40", **CAMERA_ARRAY)[0], atol=1e-3)
    assert report["planes"][0]["depth"] == 40


def test_a_single_view_has_no_depth():
    with pytest.raises(InvalidOption, match="light field: one view shows no depth"):
        run(LightField(LENSES.views[:1, :1]), disparity="0")


def test_camera_options_dont_fit_a_lens_array():
    with pytest.raises(InvalidOption, match="camera_pitch: this is for camera arrays"):
        run("vase", depth="5", lenses="8x8", pixels="3x3", backend="raytrace", **CAMERA_ARRAY)


def test_the_limit_on_pixels_counts_all_planes():
    options = KINDS["plane"].parse({"stack": "0:1:20"})
    assert options.count_planes() == 20
    with pytest.raises(TooLarge, match="20 planes of 16x20 pixels: 6,400 are over the limit of 6,399"):
        refocus(CAMERAS, options, pytest.fail, max_pixels=6399)
