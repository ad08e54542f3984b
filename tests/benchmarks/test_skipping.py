"""The table's columns say what they are said to."""

from types import SimpleNamespace

import numpy as np
import pytest

from ciir.benchmarks import skipping
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene


def test_shares_of_a_view():
    view = np.zeros((10, 20, 4), np.uint8)
    view[2:6, 5:7, 3] = 255
    view[5, 5:15, 3] = 1
    covered, box = skipping.shares(view)
    assert covered == pytest.approx((4 * 2 + 8) / 200)
    assert box == pytest.approx(4 * 10 / 200)
    assert skipping.shares(np.zeros((3, 3, 4), np.uint8)) == (0, 0)


def test_both_are_run_as_often_and_compared():
    asked = []

    def upscale(is_skipping, statistics):
        asked.append(is_skipping)
        statistics.pixels, statistics.uniform = 100, 25 * is_skipping
        return np.array([200 if is_skipping else 3], np.uint8)

    row = skipping.measured(upscale, rounds=4)
    assert row.differs == 197
    assert row.seen == 0.75
    assert asked == [True, False] + [True, False, False, True] * 2


def test_a_row_for_each_view(capsys):
    skipping.main(["--model", "bicubic", "--lenses", "24", "--full", "20", "--rounds", "1", "--only", "views", "full"])
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line]
    assert [line[1] for line in lines] == ["scene", "vase", "globe", "hamburger", "corners", "differ", "alike"]


def test_culling_is_compared_with_the_whole_scene():
    array, seen = LensArray(4, 4, 3, 3), []
    mesh = load_scene("vase").transform(frame_scene(load_scene("vase"), array))

    def views(found, array, wanted):
        seen.append(found.triangles)
        yield np.full((2, 3, 4), int(found.triangles < mesh.triangles), np.uint8)

    row = skipping.culled(mesh, array, "center", SimpleNamespace(render_views=views), rounds=2)
    assert row.differs == 6
    assert seen[::2] == [mesh.triangles] * 3
    assert row.share == 1 - seen[1] / mesh.triangles > 0.5


def test_a_row_of_culling_for_each_mesh_and_backend(capsys):
    assert skipping.main(["--only", "culling", "--lenses", "9", "--rounds", "1"]) in (0, 1)  # times may be any
    lines = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    assert {(line[0], line[1]) for line in lines} == {
        (name, backend) for name in ("vase", "globe", "hamburger") for backend in ("raster", "raytrace")
    }
    assert all(line[8] == "0" for line in lines)
