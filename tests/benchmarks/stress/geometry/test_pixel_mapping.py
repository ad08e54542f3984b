"""Pixel mapping is exact, and a mapping that loses a bit is noticed."""

import numpy as np

from ciir.benchmarks.stress.case import Effort
from ciir.benchmarks.stress.geometry import pixel_mapping
from ciir.renderer.light_field import LightField

QUICK = Effort(models=(), quick=True)


def test_it_is_exact():
    found = list(pixel_mapping.pixel_mapping(QUICK))
    assert [(one.bound, one.measured) for one in found] == [(0.0, 0.0)] * 8


def test_a_lost_bit_is_noticed(monkeypatch):
    exact = LightField.eia

    def lossy(self, *, pickup="virtual"):
        eia = exact(self, pickup=pickup).copy()
        if eia.dtype == np.uint16 and eia.shape[2] == 2:
            eia[-1, -1, 1] ^= 1
        return eia

    monkeypatch.setattr(LightField, "eia", lossy)
    broken = [one for one in pixel_mapping.pixel_mapping(QUICK) if not one.holds]
    assert [one.measured for one in broken] == [1.0] * 4
    assert all(one.what.startswith("16 bit") and "2 channels" in one.where for one in broken)


def test_views_the_wrong_way_round_are_noticed(monkeypatch):
    exact = LightField.eia
    monkeypatch.setattr(LightField, "eia", lambda self, *, pickup="virtual": exact(self))  # noqa: PLW0108 - pickup is dropped
    assert all(one.measured > 0 for one in pixel_mapping.pixel_mapping(QUICK))
