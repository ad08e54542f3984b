"""raster against raytrace at the same sampling, parallax against the formula, and what an error says."""

import subprocess
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

from ciir.errors import BackendUnavailable, InvalidOption
from ciir.renderer.backends import open_backend, selection
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read
from ciir.renderer.scene import Part, Scene, Texture
from ciir.renderer.scenes import SCENES, load_scene
from tests.support.paths import ROOT, SHARED

MESHES = ["duck.glb", "spot/spot.obj", "fuze/fuze.obj", "milk-truck.glb"]
ARRAY = LensArray(50, 50, 15, 15)
CORNERS_AND_MIDDLE = [(0, 0), (0, 14), (7, 7), (14, 0), (14, 14)]


def backend(name):
    try:
        return open_backend(name)[0]
    except BackendUnavailable as error:
        pytest.skip(str(error))


def inputs(names):
    """Shipped scenes by name, meshes of ../shared by file, in front of the array."""
    for name in names:
        if name in SCENES:
            found = load_scene(name)
        elif SHARED.is_dir():
            found = read(Bundle.from_path(SHARED / "data" / "meshes" / name), lenses=None, pixels=None)
        else:
            pytest.skip("needs ../shared")
        yield found.transform(frame_scene(found, ARRAY))


def disagreement(one, other, *, textured):
    """What is out of bounds between two sets of RGBA views `(n, rows, cols, 4)`, `other` being the exact one."""
    faults = []
    mask, exact = one[..., 3] > 0, other[..., 3] > 0
    edge = np.zeros_like(exact)
    for axis in (1, 2):
        step = np.diff(exact, axis=axis)
        before, after = [slice(None)] * 3, [slice(None)] * 3
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        edge[tuple(before)] |= step
        edge[tuple(after)] |= step
    differ = mask != exact
    # OpenGL snaps vertices to 1/256 of a pixel; an edge crosses a pixel's centre within that for about 1 in 100.
    if differ.sum() > 0.02 * edge.sum():
        faults.append(f"silhouette: {differ.sum()} of {edge.sum()} pixels at the edge differ")
    signed = int(mask.sum()) - int(exact.sum())
    if abs(signed) > max(3.0, 3.0 * np.sqrt(differ.sum())):
        faults.append(f"silhouette: biased by {signed} pixels of {differ.sum()}")
    inside = mask & exact
    error = (one[..., :3].astype(int) - other[..., :3])[inside]
    if textured:
        if np.abs(error).mean() > 2.0:
            faults.append(f"texture: mean absolute difference {np.abs(error).mean():.2f}")
        if np.abs(error.mean(0)).max() > 0.3:
            faults.append(f"texture: bias {error.mean(0)}")
    elif (np.abs(error).max(-1) <= 3).mean() < 0.995:
        faults.append(f"colour: {(np.abs(error).max(-1) > 3).mean():.4f} of the pixels differ by more than 3")
    return faults


@pytest.mark.parametrize("name", [*SCENES, *MESHES])
@pytest.mark.parametrize("samples", [1, 2])
def test_raster_draws_what_rays_meet(name, samples):
    raster, raytrace = backend("raster"), backend("raytrace")
    (placed,) = inputs([name])
    views = [
        np.stack(list(b.render_views(placed, ARRAY, CORNERS_AND_MIDDLE, samples=samples))) for b in (raster, raytrace)
    ]
    assert views[1][..., 3].any(axis=(1, 2)).all()
    textured = any(part.texture is not None for part in placed.parts)
    if samples == 1:
        assert disagreement(*views, textured=textured) == []
    # Where samples are averaged a shifted picture differs along every edge: by 2 to 10 grey levels over the object.
    covered = views[1][..., 3] > 0
    assert np.abs(views[0].astype(float) - views[1])[covered].mean() < 0.5


@pytest.mark.parametrize("name", ["hamburger", "duck.glb"])
@pytest.mark.parametrize("broken", ["shear sign", "half a pixel in x", "half a pixel in y", "upside down"])
def test_the_comparison_notices(name, broken, monkeypatch):
    raster, raytrace = backend("raster"), backend("raytrace")
    from ciir.renderer.backends import raster as module
    from ciir.renderer.backends.projections import make_oblique_matrix

    def wrong(array, view, near, far):
        matrix = make_oblique_matrix(array, view, near, far)
        if broken == "shear sign":
            matrix[:2, 2] *= -1
        elif broken == "half a pixel in x":
            matrix[0, 3] += 1 / array.cols
        elif broken == "half a pixel in y":
            matrix[1, 3] += 1 / array.rows
        else:
            matrix[1] *= -1
        return matrix

    (placed,) = inputs([name])
    exact = np.stack(list(raytrace.render_views(placed, ARRAY, CORNERS_AND_MIDDLE)))
    monkeypatch.setattr(module, "make_oblique_matrix", wrong)
    assert disagreement(np.stack(list(raster.render_views(placed, ARRAY, CORNERS_AND_MIDDLE))), exact, textured=True)


def cut_outs(wrap):
    """Two sheets, the near one full of holes where its texture and its vertices together are too clear."""
    y, x = np.mgrid[:48, :64]
    alpha = 127.5 + 127.5 * np.sin(x / 5.0) * np.cos(y / 6.0)
    pixels = np.stack([x * 4, y * 5, 255 - x * 3, alpha], axis=-1).astype(np.uint8)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uv = (corners[:, :2] * 1.7 + 0.3).astype(np.float32)
    texture = Texture(pixels, *wrap)
    thin, solid = np.ones((4, 4), np.float32), np.ones((4, 4), np.float32)
    thin[:, 3] = [0.6, 0.8, 1.0, 0.7]
    solid[:, 3] = 0.1  # says nothing where no cutoff does
    return Scene(
        (
            Part(corners * 20 - [0, 0, 30], faces, thin, uv, texture, alpha_cutoff=0.3),
            Part(corners * 24 - [0, 0, 40], faces, solid, uv, texture),
        )
    )


@pytest.mark.parametrize("wrap", [("repeat", "mirror"), ("mirror", "clamp"), ("clamp", "repeat")])
def test_cut_outs_and_wraps_agree(wrap):
    raster, raytrace = backend("raster"), backend("raytrace")
    array = LensArray(160, 160, 3, 3, pitch=0.3125)
    made = [np.stack(list(b.render_views(cut_outs(wrap), array, [(0, 2), (1, 1)]))) for b in (raster, raytrace)]
    assert disagreement(*made, textured=True) == []
    # A hole that is there in one alone, or another copy of the texture, is worth tens of grey levels.
    differ = np.abs(made[0].astype(int) - made[1]).max(-1) > 3
    assert differ.mean() < 0.003


def test_pictures_are_held_up_to_a_number_of_samples(monkeypatch):
    raster = backend("raster")
    from ciir.renderer.backends import raster as module

    (placed,) = inputs(["vase"])
    array, wanted, turns = LensArray(20, 30, 3, 3), [(0, 0), (1, 1), (2, 2)], []
    expected = list(raster.render_views(placed, array, wanted))
    submit = raster._thread.submit
    monkeypatch.setattr(raster._thread, "submit", lambda *given: turns.append(1) or submit(*given))
    monkeypatch.setattr(module, "SAMPLES_PER_BATCH", 2 * 20 * 30)
    np.testing.assert_array_equal(list(raster.render_views(placed, array, wanted)), expected)
    assert len(turns) == 2


def test_a_scene_that_fails_to_load_leaves_the_last_one(monkeypatch):
    raster = backend("raster")
    from ciir.renderer.backends import opengl as module

    vase, globe = inputs(["vase", "globe"])
    (expected,) = raster.render_views(vase, ARRAY, [(7, 7)])
    with monkeypatch.context() as broken:
        broken.setattr(module, "MatrixCamera", None)
        with pytest.raises(TypeError):
            list(raster.render_views(globe, ARRAY, [(7, 7)]))
    (again,) = raster.render_views(vase, ARRAY, [(7, 7)])
    np.testing.assert_array_equal(again, expected)


def test_a_process_that_drew_ends_without_a_word():
    backend("raster")
    code = (
        "from ciir.renderer.backends import open_backend\nfrom ciir.renderer.framing import frame_scene\n"
        "from ciir.renderer.lens_array import LensArray\nfrom ciir.renderer.scenes import load_scene\n"
        "array, globe = LensArray(9, 9, 1, 1), load_scene('globe')\n"
        "list(open_backend('raster')[0].render_views(globe.transform(frame_scene(globe, array)), array, [(0, 0)]))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)  # noqa: S603
    assert (done.stdout, done.stderr) == ("", "")


def test_a_refusal_keeps_no_caller_alive(monkeypatch):
    monkeypatch.delitem(selection._open, "raster", raising=False)
    monkeypatch.setitem(selection._refused, "raster", "raster: no display")
    raised = []
    for _ in range(2):
        with pytest.raises(BackendUnavailable) as caught:
            open_backend("raster")
        raised.append(caught.value)
    assert raised[0] is not raised[1]


@pytest.mark.parametrize("samples", [1, 2])
def test_by_lens_is_by_view(samples):
    raster = backend("raster")
    (placed,) = inputs(["globe"])
    few_lenses = LensArray(4, 6, 20, 30, pitch=10.0, delta=0.02)
    by_lens = raster.render_eia(placed, few_lenses, samples=samples)
    every = [(v, u) for v in range(20) for u in range(30)]
    by_view = np.empty_like(by_lens)
    for (v, u), view in zip(every, raster.render_views(placed, few_lenses, every, samples=samples), strict=True):
        by_view[v::20, u::30] = view
    assert by_lens[..., 3].any()
    error = by_lens.astype(int) - by_view
    # Two projections round differently: the same surface to a grey level or two, except where an edge moves over.
    assert (np.abs(error).max(-1) <= 2).mean() > 0.99
    assert np.abs(error.mean((0, 1))).max() < 0.1


@pytest.mark.parametrize("name", ["raster", "raytrace"])
def test_elemental_holds_the_views_exactly(name):
    made = backend(name)
    (placed,) = inputs(["hamburger"])
    array = LensArray(20, 30, 5, 3)
    eia = made.render_eia(placed, array)
    every = [(v, u) for v in range(5) for u in range(3)]
    for (v, u), view in zip(every, made.render_views(placed, array, every), strict=True):
        np.testing.assert_array_equal(eia[v::5, u::3], view)


@pytest.mark.parametrize("name", ["raster", "raytrace"])
def test_parallax_has_the_right_sign_and_size(name):
    """A point at distance d moves by delta*d/pitch view pixels from one view to the next (design.md, Geometry)."""
    made = backend(name)
    (placed,) = inputs(["vase"])
    bounds = placed.bounds()
    depth = bounds[1, 2] - bounds[0, 2]
    flat = placed.transform(np.diag([1.0, 1.0, 1e-6, 1.0]))
    distance = 0.7 * depth
    matrix = np.eye(4)
    matrix[2, 3] = -distance - flat.bounds()[0, 2]
    flat = flat.transform(matrix)
    fine = replace(ARRAY, rows=400, cols=400, pitch=ARRAY.pitch / 8)  # finely sampled: the centroid to a small fraction
    centroid = {}
    for view, picture in zip(CORNERS_AND_MIDDLE, made.render_views(flat, fine, CORNERS_AND_MIDDLE), strict=True):
        ys, xs = np.nonzero(picture[..., 3])
        centroid[view] = np.array([ys.mean(), xs.mean()])
    for v, u in CORNERS_AND_MIDDLE:
        moved = centroid[v, u] - centroid[7, 7]
        step = fine.delta * distance / fine.pitch
        # As u grows the rays lean right, so what they meet lies further left among the lenses; likewise up.
        np.testing.assert_allclose(moved, [-(v - 7) * step, -(u - 7) * step], atol=0.05)


@pytest.mark.parametrize("name", ["raster", "raytrace"])
def test_many_threads_at_once_get_their_own_scenes(name):
    made = backend(name)
    placed = dict(zip(SCENES, inputs(SCENES), strict=True))
    expected = {key: next(iter(made.render_views(found, ARRAY, [(3, 3)]))) for key, found in placed.items()}
    wrong = []

    def ask(key):
        again = [next(iter(made.render_views(placed[key], ARRAY, [(3, 3)]))) for _ in range(3)]
        wrong.extend(key for picture in again if not np.array_equal(picture, expected[key]))

    threads = [threading.Thread(target=ask, args=(key,)) for key in list(placed) * 3]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


@pytest.mark.parametrize("name", ["raster", "raytrace"])
@pytest.mark.parametrize("pitch", [1e-9, 1e9])
def test_units_do_not_matter(name, pitch):
    made, found = backend(name), load_scene("globe")
    views = []
    for array in (ARRAY, replace(ARRAY, pitch=pitch)):
        views += made.render_views(found.transform(frame_scene(found, array)), array, [(0, 0)])
    # float32 rounds differently at another scale: a sample on an edge may fall to its other side
    assert np.abs(views[0].astype(int) - views[1]).mean() < 0.1


@pytest.mark.parametrize("name", ["raster", "raytrace"])
def test_distance_does_not_matter(name):
    made = backend(name)
    (placed,) = inputs(["hamburger"])
    moved = np.eye(4)
    moved[2, 3] = -1e7
    (near,) = made.render_views(placed, ARRAY, [(7, 7)])
    (far,) = made.render_views(placed.transform(moved), ARRAY, [(7, 7)])
    # In float32 a surface 1e7 away would be placed to a pitch: dozens of pixels would show another.
    assert (np.abs(near.astype(int) - far).max(-1) > 3).sum() <= 1


@pytest.mark.parametrize("name", ["raster", "raytrace"])
def test_background_is_where_nothing_is(name):
    made = backend(name)
    (placed,) = inputs(["vase"])
    (view,) = made.render_views(placed, ARRAY, [(7, 7)], background=(1, 2, 3))
    empty = view[..., 3] == 0
    assert empty.any()
    assert (view[empty][:, :3] == (1, 2, 3)).all()


def test_auto_names_its_reason(monkeypatch):
    monkeypatch.delitem(selection._open, "raster", raising=False)
    monkeypatch.setitem(selection._refused, "raster", "raster: no display")
    made, reason = open_backend("auto", triangles=1, rays=1 << 20)
    assert made.name == "raytrace"
    assert "no display" in reason
    with pytest.raises(BackendUnavailable, match="no display"):
        open_backend("raster")


def test_auto_counts_rays_and_triangles():
    backend("raster")
    few = selection.FEW_RAYS
    for triangles, rays, expected in (
        (10, few, "raytrace"),
        (10, few + 1, "raster"),
        (10 * few, 10 * few, "raytrace"),
        (10 * few, 10 * few + 1, "raster"),
    ):
        made, reason = open_backend("auto", triangles=triangles, rays=rays)
        assert made.name == expected
        assert f"{rays:,} rays" in reason


def test_unknown_backend():
    with pytest.raises(InvalidOption, match="auto, raster or raytrace"):
        open_backend("vulkan")


def test_a_picture_larger_than_opengl_draws():
    raster = backend("raster")
    (placed,) = inputs(["vase"])
    with pytest.raises(InvalidOption, match="backend raytrace"):
        next(iter(raster.render_views(placed, LensArray(4096, 10, 3, 3), [(0, 0)], samples=16)))
