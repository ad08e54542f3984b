"""Culling is reported, can be disabled, and changes nothing."""

import numpy as np
import pytest

from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct

FINE = {"lenses": (20, 20), "pixels": (5, 5), "backend": "raytrace", "model": "none"}
"""The vase's triangles are 60 times as many as the rays of a view."""


def run(**options):
    """The views `(n, H, W, 3)`, and the report."""
    writer = MemoryWriter()
    report = reconstruct("vase", Options(**options), writer)
    return np.stack(list(writer.views.values())), report


@pytest.mark.parametrize("strategy", [{}, {"strategy": "direct", "scale": 1, "lenses": (10, 10)}])
def test_the_share_of_triangles_that_no_view_needs_is_reported(strategy):
    given = FINE | {"views": "cross"} | strategy
    if "strategy" in given:
        del given["model"]
    views, report = run(**given)
    whole, uncut = run(**given, skip="none")
    assert 0.4 < report["plan"]["skipped"]["culled"] < 1
    assert uncut["plan"]["skipped"]["culled"] == 0
    assert report["input"]["triangles"] == uncut["input"]["triangles"]
    np.testing.assert_array_equal(views, whole)


def test_it_stands_beside_what_the_model_did_not_see():
    _, report = run(**FINE | {"model": "bicubic"})
    assert {"pixels", "uniform", "culled"} <= report["plan"]["skipped"].keys()


def test_nothing_is_culled_for_many_views():
    _, report = run(**FINE, views="all")
    assert report["plan"]["skipped"] == {"culled": 0.0}
