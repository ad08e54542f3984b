import sys

import numpy as np
import pytest

from ciir.benchmarks.focus import planes
from ciir.benchmarks.focus.planes import HEAD, Array, compare, main, refocus_all, shift_by_numpy
from ciir.errors import InvalidOption

SMALL = Array(3, 32, np.array([-0.4, 0.0, 0.6]), 2)


@pytest.mark.parametrize("by_rows", [False, True])
def test_shifts_by_numpy_are_the_planes_of_the_package(by_rows):
    views, true = SMALL.make()
    found = shift_by_numpy(views, SMALL.disparities, by_rows=by_rows)
    np.testing.assert_allclose(found, refocus_all(views, SMALL.disparities), atol=1e-3)  # levels: float32
    inside = np.s_[8:-8, 8:-8]
    assert np.abs(found[2] - true)[inside].max() < 5
    assert np.abs(found[0] - true)[inside].max() > 20  # out of focus


def test_prints_times_errors_and_growth(capsys, monkeypatch):
    monkeypatch.setattr(planes, "CASES", {"small": SMALL, "again": SMALL})
    monkeypatch.setattr(planes, "GROWTH", {"planes": [SMALL, Array(3, 32, np.linspace(-1, 1, 64), 0)]})
    assert main(["--rounds", "1"]) == 0
    title, head, *lines, missing, growth = capsys.readouterr().out.splitlines()
    assert (title, head) == ("small", HEAD)
    ours, numpy = lines[0].split(), lines[1].split()
    assert ours[3:5] == ["1.00", "1.00"]
    assert ours[-1] == numpy[-1]
    assert "give --plenopticam" in missing
    assert growth.startswith("time by planes: power ")


def test_an_interpreter_without_plenopticam():
    with pytest.raises(InvalidOption, match="install plenopticam there"):
        compare(SMALL, 1, sys.executable)
