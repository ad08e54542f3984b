from dataclasses import replace

import numpy as np
import pytest

from ciir.benchmarks.bench.work import reconstruct_views
from ciir.benchmarks.harm import meshes
from ciir.renderer.scenes import load_scene

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")


def test_pictures_are_those_of_the_pipeline_to_the_bit():
    cases = list(meshes.list_cases("vase", load_scene("vase"), [12], ["black", "blue 3060c0"]))
    assert len(cases) == meshes.count_cases([12], ["black", "white"])
    assert {case.factors["sampling"] for case in cases} == {"pinhole", "lenslet"}
    window = ";".join(f"{v},{u}" for v in range(5, 10) for u in range(5, 10))
    for case in cases:
        plain = replace(case.options, views=window, model="none", scale=1)
        assert np.array_equal(case.views.reshape(25, 12, 12, 3), reconstruct_views(case.source, plain)[0])
        direct = replace(case.options, strategy="direct", sampling="pinhole")
        assert np.array_equal(case.truth, reconstruct_views(case.source, direct)[0][0])


def test_own_meshes_hold_untextured_grey_ones():
    for name in ("grey chair", "grey vase"):
        for part in meshes.OWN[name]().parts:
            assert part.texture is None
            assert np.ptp(part.colors[:, :3], axis=1).max() < 1e-6
            assert part.colors[:, 0].max() > 0.5
    assert {"vase", "globe", "hamburger"} < set(meshes.OWN)
