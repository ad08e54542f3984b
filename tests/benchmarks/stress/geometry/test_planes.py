import pytest

from ciir.benchmarks.stress.case import Effort
from ciir.benchmarks.stress.geometry import planes
from ciir.renderer.focus.planes import refocus

QUICK = Effort(models=(), quick=True)


def test_bounds_hold():
    found = list(planes.depth_planes(QUICK))
    assert len(found) == 8
    assert all(one.holds for one in found)


@pytest.mark.parametrize(
    ("change", "broken"), [(lambda p: p + 1e-5, 3), (lambda p: p * 1.0001, 2), (lambda p: p + 1e-3 * p**2, 3)]
)
def test_planes_that_are_off_are_noticed(monkeypatch, change, broken):
    monkeypatch.setattr(planes, "refocus", lambda *given, **options: map(change, refocus(*given, **options)))
    found = [one for one in planes.depth_planes(QUICK) if "mapping" in one.what]
    assert sum(not one.holds for one in found) == broken


def test_noise_is_averaged():
    assert all(one.holds for one in planes.noise_in_planes(QUICK))


def test_planes_that_keep_too_much_noise_are_noticed(monkeypatch):
    monkeypatch.setattr(planes, "refocus", lambda *given, **options: (1.3 * p for p in refocus(*given, **options)))
    assert not any(one.holds for one in planes.noise_in_planes(QUICK) if "whole" in one.what)
