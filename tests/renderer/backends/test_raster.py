"""What OpenGL draws, and how one thread draws it for all callers."""

import subprocess
import sys

import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.lens_array import LensArray
from tests.support.backends import ARRAY, place_scene, require_backend
from tests.support.paths import ROOT


def test_pictures_are_held_up_to_a_number_of_samples(monkeypatch):
    raster = require_backend("raster")
    from ciir.renderer.backends import raster as module

    placed, array, views, batches = place_scene("vase"), LensArray(20, 30, 3, 3), [(0, 0), (1, 1), (2, 2)], []
    expected = list(raster.render_views(placed, array, views))
    submit = raster._thread.submit
    monkeypatch.setattr(raster._thread, "submit", lambda *given: batches.append(1) or submit(*given))
    monkeypatch.setattr(module, "SAMPLES_PER_BATCH", 2 * 20 * 30)
    np.testing.assert_array_equal(list(raster.render_views(placed, array, views)), expected)
    assert len(batches) == 2


def test_a_scene_that_fails_to_load_leaves_the_last_one(monkeypatch):
    raster = require_backend("raster")
    from ciir.renderer.backends import opengl

    vase, globe = place_scene("vase"), place_scene("globe")
    (expected,) = raster.render_views(vase, ARRAY, [(7, 7)])
    with monkeypatch.context() as broken:
        broken.setattr(opengl, "MatrixCamera", None)
        with pytest.raises(TypeError):
            list(raster.render_views(globe, ARRAY, [(7, 7)]))
    (again,) = raster.render_views(vase, ARRAY, [(7, 7)])
    np.testing.assert_array_equal(again, expected)


def test_a_process_that_drew_ends_silently():
    require_backend("raster")
    code = (
        "from ciir.renderer.backends import open_backend\nfrom ciir.renderer.framing import frame_scene\n"
        "from ciir.renderer.lens_array import LensArray\nfrom ciir.renderer.scenes import load_scene\n"
        "array, globe = LensArray(9, 9, 1, 1), load_scene('globe')\n"
        "list(open_backend('raster')[0].render_views(globe.transform(frame_scene(globe, array)), array, [(0, 0)]))\n"
        "import sys; assert not {'scipy', 'trimesh', 'networkx', 'freetype'} & set(sys.modules)"  # half a second
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)  # noqa: S603
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.parametrize("samples", [1, 2])
def test_by_lens_is_by_view(samples):
    raster, placed = require_backend("raster"), place_scene("globe")
    few_lenses = LensArray(4, 6, 20, 30, pitch=10.0, delta=0.02)
    counts = []
    by_lens = raster.render_eia(placed, few_lenses, samples=samples, progress=lambda *count: counts.append(count))
    assert counts == [(done, 24) for done in range(1, 25)]
    every = [(v, u) for v in range(20) for u in range(30)]
    by_view = np.empty_like(by_lens)
    for (v, u), view in zip(every, raster.render_views(placed, few_lenses, every, samples=samples), strict=True):
        by_view[v::20, u::30] = view
    assert by_lens[..., 3].any()
    error = by_lens.astype(int) - by_view
    # Two projections round differently: the same surface to a grey level or two, except where an edge moves over.
    assert (np.abs(error).max(-1) <= 2).mean() > 0.99
    assert np.abs(error.mean((0, 1))).max() < 0.1


def test_a_picture_larger_than_opengl_draws():
    raster, placed = require_backend("raster"), place_scene("vase")
    with pytest.raises(InvalidOption, match="backend raytrace"):
        next(raster.render_views(placed, LensArray(4096, 10, 3, 3), [(0, 0)], samples=16))
    with pytest.raises(InvalidOption, match="backend raytrace"):
        next(raster.render_depth(placed, LensArray(1 << 16, 1, 3, 3), [(0, 0)]))
