from types import SimpleNamespace

import numpy as np

from ciir.benchmarks import skipping
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene
from tests.support.backends import require_backend


def test_results_with_and_without_skipping_are_compared():
    def upscale(is_skipping, statistics):
        statistics.pixels, statistics.uniform = 100, 25 * is_skipping
        return np.array([200 if is_skipping else 3], np.uint8)

    seen, *_, differs = skipping.measure_skipping(upscale, rounds=2)
    assert (seen, differs) == ("0.750", "197")


def test_a_row_for_each_view(capsys):
    skipping.main(["--model", "bicubic", "--lenses", "24", "--rounds", "1", "--only", "views", "full"])
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line[1] for line in lines] == ["scene", "vase", "globe", "hamburger", "noise"]


def test_culling_is_compared_with_the_whole_scene():
    array = LensArray(4, 4, 3, 3)
    mesh = load_scene("vase").transform(frame_scene(load_scene("vase"), array))

    def render_views(scene, array, views):
        yield np.full((2, 3, 4), int(scene.triangles < mesh.triangles), np.uint8)

    backend = SimpleNamespace(render_views=render_views)
    share, *_, differs = skipping.measure_culling(mesh, array, [(1, 1)], backend, rounds=1)
    assert differs == 6
    assert 0.5 < share < 1


def test_a_row_of_culling_for_each_mesh_and_backend(capsys):
    require_backend("raster")
    assert skipping.main(["--only", "culling", "--lenses", "9", "--rounds", "1"]) in (0, 1)  # times may be any
    lines = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    assert {(line[0], line[1]) for line in lines} == {
        (name, backend) for name in ("vase", "globe", "hamburger") for backend in ("raster", "raytrace")
    }
    assert all(line[8] == "0" for line in lines)
