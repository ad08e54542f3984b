import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.focus.disparity import DisparityMap
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.pictures import encode
from ciir.service.pipeline.focus.disparities import find_disparity
from ciir.service.pipeline.options import KINDS
from tests.support.inputs import make_off

MESH = {"lenses": "24x24", "pixels": "5x5", "backend": "raytrace"}


def make_plane(disparity, sense="cameras"):
    """5x5 views of a textured plane of a whole disparity."""
    texture = np.random.default_rng(0).integers(0, 256, (60, 60, 3), np.uint8)
    views = np.empty((5, 5, 32, 36, 3), np.uint8)
    for v in range(5):
        for u in range(5):
            y, x = 10 + disparity * (v - 2), 10 + disparity * (u - 2)
            views[v, u] = texture[y : y + 32, x : x + 36]
    return LightField(views, is_ordered=True, depth_sense=sense)


def run(source, **texts):
    return find_disparity(source, KINDS["disparity"].parse(texts))


@pytest.mark.parametrize(("sense", "sign"), [("cameras", 1), ("lenses", -1)])
def test_larger_is_nearer_with_both_depth_senses(sense, sign):
    limits = "-0.5:2.5" if sign == 1 else "-2.5:0.5"
    found, report = run(make_plane(1, sense), limits=limits)
    assert np.median(found.hci) == pytest.approx(sign, abs=0.05)  # a sixteenth of a plane's spacing
    assert report["disparity"]["view"] == [2, 2]
    assert not report["disparity"]["exact"]
    assert report["disparity"]["least"] <= sign <= report["disparity"]["largest"]
    assert {"focus", "total"} <= set(report["timings_ms"])


@pytest.mark.parametrize("place", ["-1", "0", "0.7"])
@pytest.mark.parametrize("factor", [0.25, 0.5, 2])
def test_a_depth_factor_multiplies_disparities(place, factor):
    """Those of the centre view, whose picture stays."""
    whole, flat = (run("vase", **MESH, place=place, depth_factor=f"{each}")[0].hci for each in (1, factor))
    assert np.ptp(whole) > 0.2
    assert flat == pytest.approx(factor * whole, abs=1e-5)


def test_a_plain_background_has_no_part_in_the_range():
    views = np.zeros((3, 5, 64, 96, 3), np.uint8)
    texture = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)
    for v, u in np.ndindex(3, 5):
        views[v, u, 22 - 2 * (v - 1) :, 33 - 2 * (u - 2) :][:20, :30] = texture
    _, report = run(LightField(views, is_ordered=True, depth_sense="cameras"), limits="-6:6")
    found = report["disparity"]
    assert found["least"] < 0
    assert (found["confident"]["least"], found["confident"]["largest"]) == pytest.approx((2, 2), abs=0.1)
    assert found["confident"]["confidence"] <= 0.5


def test_few_wrong_pixels_have_no_part_in_the_range(monkeypatch):
    disparity = np.ones((32, 36), np.float32)
    disparity[:2, :5] = -22  # 10 of 1152 pixels, less than a hundredth
    wrong = DisparityMap((2, 2), disparity, np.ones_like(disparity), np.arange(2.0), "cameras")
    monkeypatch.setattr("ciir.service.pipeline.focus.disparities.estimate_view", lambda *_: wrong)
    _, report = run(make_plane(1))
    assert report["disparity"]["least"] == -22
    assert report["disparity"]["confident"] == {"least": 1, "largest": 1, "confidence": 0.5}


def test_geometry_that_a_map_does_not_use_is_noted():
    source = Bundle.from_upload("eia.png", encode(make_plane(1).eia(), ".png"))
    _, report = run(source, pixels="5x5", pitch="1", parallax="20")
    assert any(note.startswith("pitch, parallax: a disparity map is in pixels") for note in report["notes"])


def test_views_without_texture_have_no_range():
    plain = np.broadcast_to(np.arange(20, 70, 10, np.uint8)[:, None, None, None], (1, 5, 32, 36, 3))
    _, report = run(LightField(plain.copy(), depth_sense="cameras"))
    assert report["disparity"]["confident"] is None


def test_another_view():
    found, _ = run(make_plane(1), view="0,4", limits="-0.5:2.5")
    assert found.view == (0, 4)
    assert np.median(found.hci) == pytest.approx(1, abs=0.05)


def test_after_upscaling_the_limits_are_as_before_and_the_map_is_larger():
    found, report = run(make_plane(1), model="nearest", scale="2", limits="-0.5:2.5")
    assert found.disparity.shape == (64, 72)
    assert np.median(found.hci) == pytest.approx(2, abs=0.1)
    assert "in pixels of the upscaled views, 2 for each" in report["notes"][0]


def test_that_of_a_mesh_is_exact():
    square = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    bundle = Bundle.from_upload("square.off", make_off(square, [(0, 1, 2), (0, 2, 3)]))
    found, report = run(bundle, **MESH, pitch="0.5", delta="0.1", view="1,3")
    depth = -report["scene_transform"][2][3]
    assert depth > 0
    np.testing.assert_allclose(found.hci, -0.1 / 0.5 * depth, rtol=1e-5)  # float32
    seen = found.confidence == 1
    assert 0.2 < seen.mean() < 1
    assert (found.confidence[~seen] == 0).all()
    assert (report["disparity"]["exact"], report["disparity"]["view"]) == (True, [1, 3])


@pytest.mark.parametrize(
    ("given", "notes"),
    [
        ({}, []),
        ({"background": "red"}, ["background: a disparity map doesn't depend on this; leave background out"]),
        (
            {"background": "red", "light": "10,10"},
            ["background and light: a disparity map doesn't depend on this; leave background and light out"],
        ),
    ],
)
def test_options_on_looks_that_change_no_disparity_are_noted(given, notes):
    assert run("vase", **MESH, **given)[1]["notes"] == notes


def test_where_a_mesh_is_not_seen_it_is_as_far_as_its_farthest_point():
    found, _ = run("vase", **MESH)
    seen = found.confidence == 1
    assert 0.1 < seen.mean() < 0.9
    assert (found.hci[~seen] == found.hci[seen].min()).all()
    assert found.hci[seen].max() > found.hci[seen].min()


@pytest.mark.parametrize(
    ("source", "texts", "message"),
    [
        (make_plane(0), {"limits": "2:1"}, "limits: 2:1 is not a range"),
        (make_plane(0), {"view": "5,0"}, "view: 5,0 is not there; v goes from 0 to 4"),
        ("vase", {**MESH, "limits": "0:1"}, "limits: the disparity of a mesh is rendered"),
        ("vase", {**MESH, "sampling": "lenslet"}, "sampling: the disparity of a mesh is that of each lens's centre"),
        ("vase", {**MESH, "model": "auto"}, "model: the disparity of a mesh is rendered"),
        ("vase", {**MESH, "view": "9,9"}, "views: 9,9 is not there"),
        (LightField(make_plane(0).views[:1, :1]), {}, "one view shows no depth"),
    ],
)
def test_what_is_asked_for_must_fit(source, texts, message):
    with pytest.raises(InvalidOption, match=message):
        run(source, **texts)
