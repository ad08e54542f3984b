import io
import re

import numpy as np
import pytest

from ciir import models
from ciir.errors import InvalidOption, TooLarge
from ciir.models.back_projection import restore_means
from ciir.renderer.backends import open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.elemental import render_eia
from ciir.service.pipeline.job import resolve_array
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct
from ciir.service.pipeline.stages import schedule
from tests.support.inputs import CUBE, EIA, EIA_PNG, make_off, make_picture
from tests.support.meshes.gltf import Model
from tests.support.paths import SHARED
from tests.support.pipeline import SMALL, Recorder, eia_bundle, run

needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared")


@pytest.mark.parametrize(("channels", "dtype"), [(1, np.uint8), (2, np.uint16), (3, np.uint16), (4, np.uint8)])
def test_without_a_model_views_are_the_eia_bit_for_bit(channels, dtype):
    eia = make_picture(24, 36, channels, dtype)
    views, report = run(eia_bundle(eia), lenses=(6, 9), views="all", model="none")
    assert set(views) == {(v, u) for v in range(4) for u in range(4)}
    for (v, u), pixels in views.items():
        assert pixels.dtype == dtype
        assert np.array_equal(pixels, eia[v::4, u::4])
    assert report["input"] == {
        "name": "eia.png", "kind": "png", "bytes": len(encode_png(eia)), "files": 1,
        "height": 24, "width": 36, "channels": channels, "bits": dtype().itemsize * 8,
    }  # fmt: skip
    assert report["lens_array"] == {
        "rows": 6, "cols": 9, "pitch": None, "pixels_v": 4, "pixels_u": 4, "delta": None, "depth_sense": "lenses",
    }  # fmt: skip
    assert report["scene_transform"] is None
    assert report["model"] is None
    assert set(report["timings_ms"]) == {"decode", "plan", "map", "encode", "total"}


def test_what_was_skipped_is_a_reason():
    plain = np.zeros((64 * 3, 64 * 3, 3), np.uint8)
    plain[90:100, 90:100] = 200
    _, report = run(eia_bundle(plain), lenses=(64, 64), model="fast")
    skipped = report["plan"]["skipped"]
    percent = 100 * skipped["uniform"]
    assert percent > 50
    assert report["plan"]["reasons"][-1] == (
        f"skipped: the model for {percent:.0f} % of its pixels, which are uniform background"
    )
    _, report = run(eia_bundle(EIA), lenses=(6, 9), model="fast", skip="none")
    assert not any(reason.startswith("skipped") for reason in report["plan"]["reasons"])


def test_an_optical_pickup_is_turned_back():
    turned = LightField.from_eia(EIA, rows=6, cols=9).eia(pickup="optical")
    views, _ = run(eia_bundle(turned), lenses=(6, 9), views="0,3", model="none", pickup="optical")
    assert np.array_equal(views[0, 3], EIA[0::4, 3::4])


@pytest.mark.parametrize("model", ["fast", "field"])
def test_upscaled_views_of_lenslets_keep_their_means(cube, model):
    array = {"lenses": (24, 24), "pixels": (5, 5)}
    eia = []
    render_eia(cube, Options(**array, sampling="lenslet"), eia.append)
    given = eia_bundle(eia[0])
    mapped, _ = run(given, lenses=(24, 24), model="none")
    plain, report = run(given, lenses=(24, 24), model=model)
    assert report["plan"]["sampling"] is None
    from_eia, report = run(given, lenses=(24, 24), model=model, sampling="lenslet")
    assert report["plan"]["sampling"] == "lenslet"
    assert "brought closer to the means" in report["plan"]["reasons"][-1]
    assert not np.array_equal(from_eia[2, 2], plain[2, 2])
    if model == "fast":  # what a light-field network makes of means is restored without the option too
        assert np.array_equal(from_eia[2, 2], restore_means(plain[2, 2], mapped[2, 2]))
    from_mesh, _ = run(cube, **array, model=model, sampling="lenslet", neighbour_time=0)  # no closer views
    assert np.array_equal(from_mesh[2, 2], from_eia[2, 2])


@pytest.mark.parametrize(
    ("eia", "model", "where"),
    [(EIA, "bicubic", "interpolation"), (np.dstack([EIA, EIA[..., :1]]), "fast", "views with transparency")],
)
def test_sampling_that_changes_nothing_is_noted(eia, model, where):
    plain, _ = run(eia_bundle(eia), lenses=(6, 9), model=model)
    given, report = run(eia_bundle(eia), lenses=(6, 9), model=model, sampling="lenslet")
    assert report["plan"]["reasons"][-1] == f"sampling lenslet: changes nothing in {where}"
    assert report["notes"][-1] == f"sampling lenslet: changes nothing in {where}"
    assert all(np.array_equal(given[view], plain[view]) for view in plain)


def test_upscaled_views_are_what_the_model_makes_of_them():
    views, report = run(eia_bundle(EIA), lenses=(6, 9), views="cross", model="bicubic", scale=3)
    assert len(views) == 5
    for (v, u), pixels in views.items():
        mapped = np.ascontiguousarray(EIA[v::4, u::4])[np.newaxis]
        assert np.array_equal(pixels, models.upscale_pixels(models.load_upscaler("bicubic", scale=3), mapped)[0])
    assert report["model"] == {"name": "bicubic", "scale": 3, "sha256": None}
    assert report["views"][0] == {"v": 0, "u": 2, "file": "view_00_02.png", "height": 18, "width": 27}


def test_batches_change_nothing(cube, monkeypatch):
    for source, options in ((eia_bundle(EIA), {"lenses": (6, 9)}), (cube, SMALL)):
        whole, _ = run(source, views="all", model="bicubic", **options)
        counts = []
        with monkeypatch.context() as patch:
            patch.setattr(schedule, "BATCH_PIXELS", 1000)
            writer = Recorder()
            asked = Options(views="all", model="bicubic", **options)
            reconstruct(source, asked, writer, progress=lambda done, total, counts=counts: counts.append((done, total)))
        assert len(counts) > 2
        assert counts[0] == (0, len(whole))
        assert counts[-1] == (len(whole), len(whole))
        assert counts == sorted(set(counts))
        assert all(np.array_equal(writer.views[view], whole[view]) for view in whole)


def test_a_mesh_with_no_option(cube):
    views, report = run(cube)
    assert {view: pixels.shape for view, pixels in views.items()} == {(7, 7): (200, 200, 3)}
    assert report["lens_array"]["rows"] == report["lens_array"]["cols"] == 100
    assert report["input"]["triangles"] == 12
    assert set(report["timings_ms"]) == {"decode", "plan", "render", "upscale", "encode", "total"}
    total = report["timings_ms"].pop("total")
    assert total >= sum(report["timings_ms"].values()) - 0.1


def test_a_mesh_rendered_by_hand_through_the_reported_transform(cube):
    views, report = run(cube, views="all", model="none", background=(9, 8, 7), **SMALL)
    options = Options(**SMALL)
    scene = read(cube)
    array = resolve_array(options)
    matrix = np.array(report["scene_transform"])
    assert np.array_equal(matrix, frame_scene(scene, array))
    backend, _ = open_backend("raytrace")
    expected = backend.render_views(scene.transform(matrix), array, list(views), background=(9, 8, 7))
    for view, picture in zip(views, expected, strict=True):
        assert np.array_equal(views[view], picture[..., :3])
    assert report["plan"]["backend"] == "raytrace"
    assert report["plan"]["sampling"] == "pinhole"


def test_parallax_follows_depth():
    """A point at distance d moves by delta*d/pitch pixels from view to view: left as u grows, up as v grows."""
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    depths = {"left": (0.0, 0.0), "right": (8.0, -6.0)}  # x, z of two squares of side 1
    vertices = [(x + a, b, z) for x, z in depths.values() for a, b in corners]
    mesh = make_off(vertices, [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])
    options = {"lenses": (96, 120), "pixels": (7, 9), "backend": "raytrace", "model": "none", "sampling": "lenslet"}
    views, report = run(Bundle.from_upload("squares.off", mesh), views="all", **options)
    array, matrix = report["lens_array"], np.array(report["scene_transform"])
    for half, (x, z) in zip((np.s_[:, :60], np.s_[:, 60:]), depths.values(), strict=True):
        distance = -(matrix @ (x + 0.5, 0.5, z, 1.0))[2]
        expected = array["delta"] * distance / array["pitch"]

        def centre(view, half=half):
            light = views[view].sum(axis=2)[half].astype(float)
            rows, cols = np.indices(light.shape)
            return np.array([(rows * light).sum(), (cols * light).sum()]) / light.sum()

        for step in range(1, 9):
            moved = centre((3, step)) - centre((3, 0))
            assert moved == pytest.approx([0, -step * expected], abs=0.26)  # a sample is a quarter of a pixel
        for step in range(1, 7):
            moved = centre((step, 4)) - centre((0, 4))
            assert moved == pytest.approx([-step * expected, 0], abs=0.26)
        assert expected > 0.05


def test_direct_is_the_area_average_of_a_finer_array(cube):
    views, report = run(cube, views="0,1", strategy="direct", scale=2, **SMALL)
    array = resolve_array(Options(**SMALL))
    scene = read(cube)
    backend, _ = open_backend("raytrace")
    placed = scene.transform(frame_scene(scene, array))
    (expected,) = backend.render_views(placed, array.refine(2), [(0, 1)], samples=4)
    assert np.array_equal(views[0, 1], expected[..., :3])
    assert (report["plan"]["strategy"], report["model"], report["plan"]["sampling"]) == ("direct", None, None)
    assert "upscale" not in report["timings_ms"]


def test_lenslets_average_where_pinholes_pick(cube):
    pinhole, _ = run(cube, views="0,0", model="none", **SMALL)
    lenslet, report = run(cube, views="0,0", model="none", sampling="lenslet", **SMALL)
    assert not np.array_equal(pinhole[0, 0], lenslet[0, 0])
    assert report["plan"]["samples"] == 4


def test_a_scene_by_name():
    views, report = run("vase", model="none", views="1,1", **(SMALL | {"pixels": (3, 3)}))
    assert report["input"]["kind"] == "scene"
    assert report["input"]["name"] == "scene:vase"
    assert views[1, 1].any()
    with pytest.raises(InvalidOption, match=r"teapot.*vase"):
        run("teapot")


def test_a_set_of_views_equals_its_eia():
    files = {f"view_{v:02d}_{u:02d}.png": encode_png(EIA[v::4, u::4]) for v in range(4) for u in range(4)}
    from_set, report = run(Bundle("set", None, files), views="cross", model="bicubic")
    from_eia, _ = run(eia_bundle(EIA), lenses=(6, 9), views="cross", model="bicubic")
    assert report["input"]["kind"] == "views"
    assert report["input"]["files"] == 5
    assert from_set.keys() == from_eia.keys()
    assert all(np.array_equal(from_set[view], from_eia[view]) for view in from_set)


@pytest.mark.parametrize("options", [{"lenses": (5, 5)}, {"pickup": "optical"}])
def test_what_is_for_an_eia_is_refused_for_a_set(options):
    with pytest.raises(InvalidOption, match=next(iter(options))):
        run(Bundle("set", None, {"view_00_00.png": EIA_PNG}), **options)


@pytest.mark.parametrize("options", [{"delta": 1e9}, {"views": "0,0;2,4", "delta": 1e9, "sampling": "lenslet"}])
def test_a_mesh_that_no_view_shows_is_noted(cube, options):
    views, report = run(cube, model="none", **(SMALL | options))
    assert not any(pixels.any() for pixels in views.values())
    assert [note for note in report["notes"] if "shows the object" in note]


def test_a_mesh_of_which_only_hidden_backs_are_seen_is_noted():
    bundle = Bundle.from_upload("square.glb", Model().glb())  # faces +z, and is turned away
    for rotate, words in ((180, "or only back faces are seen, which its materials hide"), (0, None)):
        views, report = run(bundle, model="none", views="1,2", rotate=(rotate, 0, 0), **SMALL)
        assert any(pixels.any() for pixels in views.values()) == (words is None)
        assert words is None or any(words in note for note in report["notes"])


def test_a_black_mesh_is_seen():
    """By what it covers, not by its colour; and one view of several is enough."""
    black = re.sub(rb"(?m)^(4 .+)$", rb"\1 0 0 0", CUBE)
    for views in ("all", "1,2"):
        _, report = run(Bundle.from_upload("cube.off", black), model="none", views=views, **SMALL)
        (note,) = report["notes"]
        assert "hardly stands out" in note


def test_the_writer_refuses_before_a_backend_is_opened(cube, monkeypatch):
    monkeypatch.setattr("ciir.renderer.backends.open_backend", pytest.fail)
    with pytest.raises(InvalidOption, match=r"png holds one view and 5 .*; give zip or npz, or one view"):
        reconstruct(cube, Options(views="cross", **SMALL), FileWriter(io.BytesIO(), "png"))


def test_limit_on_all_pixels_together():
    writer = Recorder()
    options = Options(lenses=(6, 9), views="all", model="bicubic")
    with pytest.raises(TooLarge, match="16 views of 12x18"):
        reconstruct(eia_bundle(EIA), options, writer, max_pixels=16 * 12 * 18 - 1)
    assert writer.begun is None
    reconstruct(eia_bundle(EIA), options, writer, max_pixels=16 * 12 * 18)


@needs_shared
def test_knights_as_a_folder_and_as_an_eia():
    folder = Bundle.from_path(SHARED / "data/lightfields/knights")
    from_folder, report = run(folder, views="cross", model="none")
    middle = LightField(read(folder).views[:, :, 96:160, 96:160])  # what is quick to encode
    from_eia, _ = run(eia_bundle(middle.eia()), lenses=(64, 64), views="cross", model="none")
    assert report["lens_array"]["pixels_v"] == report["lens_array"]["pixels_u"] == 17
    assert from_folder.keys() == from_eia.keys()
    assert len(from_eia) == 5
    assert all(np.array_equal(from_folder[view][96:160, 96:160], from_eia[view]) for view in from_eia)
    assert from_folder[8, 8].shape == (256, 256, 3)


@needs_shared
def test_the_duck_with_five_views():
    duck = Bundle.from_path(SHARED / "data/meshes/duck.glb")
    views, report = run(duck, lenses=(50, 50), pixels=(15, 15), views="cross", backend="raytrace")
    assert list(views) == [(0, 7), (7, 0), (7, 7), (7, 14), (14, 7)]
    assert {pixels.shape for pixels in views.values()} == {(100, 100, 3)}
    plain, _ = run(duck, lenses=(50, 50), pixels=(15, 15), views="all", backend="raytrace", model="none")
    for pixels in plain.values():
        assert pixels.max() > 200
        assert not pixels[[0, -1]].any()  # nothing is cut off
        assert not pixels[:, [0, -1]].any()
    assert report["input"]["triangles"] == 4212
