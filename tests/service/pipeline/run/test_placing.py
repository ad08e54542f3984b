"""Placement from the options to the views and the report."""

import numpy as np
import pytest

from ciir.benchmarks.stress.geometry.rays import build_slow_sight
from ciir.errors import InvalidOption
from ciir.renderer.lens_array import LensArray
from ciir.renderer.placement import Placement
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.pipeline.elemental import render_eia
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct
from tests.support.inputs import EIA_PNG

SMALL = {"lenses": (14, 12), "pixels": (3, 5)}
TURNED = {"up": "z", "rotate": (35.0, 25.0, -15.0), "zoom": 1.4, "parallax": 40.0, "light": (70.0, 10.0)}


def run(source, **options):
    writer = MemoryWriter()
    return writer.views, reconstruct(source, Options(model="none", **SMALL, **options), writer)


@pytest.mark.parametrize("backend", ["raster", "raytrace"])
@pytest.mark.parametrize("place", [-1.0, 0.0, 1.0])
def test_views_are_rays_through_the_reported_transform(cube, place, backend):
    """Cast one by one in float64 through the mesh, lit and transformed as the report says."""
    views, report = run(cube, views="0,0;1,2;2,4", place=place, backend=backend, background=(9, 90, 200), **TURNED)
    placement = Placement("z", TURNED["rotate"], TURNED["zoom"], place, TURNED["light"])
    scene = read(cube, placement=placement).transform(np.array(report["scene_transform"]))
    sight = build_slow_sight(scene)
    stated = {name: value for name, value in report["lens_array"].items() if name != "depth_sense"}
    array = LensArray(**stated)
    assert array.delta * 5 == pytest.approx(2 * np.tan(np.radians(20)))
    x, y = np.meshgrid(array.lens_x(), array.lens_y())
    for (v, u), picture in views.items():
        direction = np.array([array.tangent_x()[u], array.tangent_y()[v], -1.0])
        seen = sight(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), direction).reshape(14, 12, 4)
        expected = np.where(seen[..., 3:] > 0, seen[..., :3], (9, 90, 200))
        # OpenGL snaps edges to 1/256 of a pixel: one of a few dozen samples at edges may fall to their other side.
        assert (np.abs(picture - expected).max(axis=2) > 2).sum() <= 1
    assert np.sign(-scene.bounds()[:, 2]).tolist() == {-1.0: [1, 1], 0.0: [1, -1], 1.0: [-1, -1]}[place]


@pytest.mark.parametrize("place", [0.0, 1.0])
def test_skipping_changes_nothing(place):
    source, options = "globe", {"lenses": (60, 60), "pixels": (3, 3), "model": "fast", "place": place, "zoom": 0.4}
    views, skipped = {}, {}
    for skip in ("exact", "none"):
        writer = MemoryWriter()
        report = reconstruct(source, Options(**options, skip=skip, backend="raytrace"), writer)
        views[skip], skipped[skip] = writer.views[1, 1], report["plan"]["skipped"]
    assert skipped["exact"]["culled"] > 0.5
    assert skipped["exact"]["uniform"] > 0.2
    assert np.array_equal(views["exact"], views["none"])


def test_an_elemental_image_array_is_placed_as_its_views(cube):
    kept = []
    report = render_eia(cube, Options(**SMALL, **TURNED, place=0.5), kept.append)
    views, other = run(cube, views="all", place=0.5, **TURNED)
    assert report["scene_transform"] == other["scene_transform"]
    for (v, u), view in views.items():
        assert np.array_equal(kept[0][v::3, u::5], view)


def test_the_defaults_are_as_without_the_options(cube):
    stated = {"up": "y", "rotate": (0.0, 0.0, 0.0), "zoom": 1.0, "place": -1.0, "fit": "views"}
    (one, report), (other, again) = run(cube), run(cube, **stated)
    assert np.array_equal(one[1, 2], other[1, 2])
    assert report["scene_transform"] == again["scene_transform"]


def test_delta_and_parallax_exclude_each_other(cube):
    with pytest.raises(InvalidOption, match="delta, parallax: both"):
        run(cube, delta=0.1, parallax=20.0)


def test_a_mesh_that_is_not_fitted_stays_where_it_is(cube):
    _, report = run(cube, fit="none")
    assert np.array_equal(report["scene_transform"], np.eye(4))
    with pytest.raises(InvalidOption, match="fit, place: with fit none"):
        run(cube, fit="none", place=0.0)


def test_pictures_may_have_a_parallax_but_no_place():
    picture = Bundle.from_upload("eia.png", EIA_PNG)
    options = {"pixels": (4, 4), "model": "none"}
    report = reconstruct(picture, Options(**options, parallax=90.0), MemoryWriter())
    assert report["lens_array"]["delta"] == pytest.approx(0.5)
    for name, value in {"up": "z", "rotate": (1.0, 0, 0), "zoom": 2.0, "place": 0.0, "light": (0.0, 0.0)}.items():
        with pytest.raises(InvalidOption, match=f"{name}: this is for meshes"):
            reconstruct(picture, Options(**options, **{name: value}), MemoryWriter())


def test_a_scene_in_memory_keeps_its_light(cube):
    scene = read(cube)
    run(scene, place=0.0, zoom=2.0)
    with pytest.raises(InvalidOption, match="light baked in"):
        run(scene, rotate=(10.0, 0.0, 0.0))


@pytest.mark.parametrize("background", [(0, 0, 0), (255, 255, 255)])
def test_a_black_object_on_black_is_noted(background):
    square = b"mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    black = Bundle("black", "a.obj", {"a.obj": square, "a.mtl": b"newmtl a\nKd 0 0 0\n"})
    _, report = run(black, background=background)
    assert any("give another one, such as background ffffff" in note for note in report["notes"]) == (
        background[0] == 0
    )


def test_a_see_through_material_takes_rays():
    square = b"mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    glass = Bundle("glass", "a.obj", {"a.obj": square, "a.mtl": b"newmtl a\nKd 1 1 1\nd 0.4\n"})
    views, report = run(glass, background=(0, 0, 200), strategy="upscale")
    assert report["plan"]["backend"] == "raytrace"
    assert "see-through" in report["plan"]["reasons"][-1]
    light = views[1, 2].reshape(-1, 3).max(axis=0)
    assert light[2] - light[0] == pytest.approx(0.6 * 200, abs=1.5)
    _, report = run(glass, backend="raster", background=(0, 0, 200))
    assert any("see-through" in note for note in report["notes"])
