"""Rows of culling: both ways are run as often, and what differs is told."""

from types import SimpleNamespace

import numpy as np

from benchmarks import culling
from renderer.framing import frame
from renderer.lens_array import LensArray
from renderer.scenes import scene


def test_both_are_run_as_often_and_compared():
    array, seen = LensArray(4, 4, 3, 3), []
    mesh = scene("vase").transformed(frame(scene("vase"), array))

    def views(found, array, wanted):
        seen.append(found.triangles)
        yield np.full((2, 3, 4), int(found.triangles < mesh.triangles), np.uint8)

    row = culling.measured(mesh, array, [(1, 1)], SimpleNamespace(views=views), rounds=2)
    assert row.differs == 6
    assert seen[::2] == [mesh.triangles] * 3
    assert row.culled == 1 - seen[1] / mesh.triangles > 0.5


def test_a_row_for_each_that_pays(capsys):
    assert culling.main(["--lenses", "9", "--rounds", "1"]) in (0, 1)  # times of one round may say anything
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert {line[0] for line in lines[1:]} == {"vase", "globe", "hamburger"}
    assert {line[-1] for line in lines[1:]} <= {"0", "!"}
    assert all(line[9] == "0" for line in lines[1:])
