"""Networks of light fields have the windows that the pipeline would give them."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")

from ciir.benchmarks.harm import score
from ciir.bit_depth import round_to_depth
from ciir.models import catalogue
from ciir.models.light_field.views import _upscale_single
from ciir.models.single.pixels import upscale_pixels
from tests.support.networks import StandIn


@pytest.mark.parametrize("is_light_field", [True, False])
def test_windows_are_those_of_the_pipeline(monkeypatch, is_light_field):
    """Of every second view where content hardly moves, but of a mesh's views the nearest."""
    monkeypatch.setattr(score, "choose_stride", lambda motion, grid: 2)
    # The views of even rows and columns are dark, the others light: the stand-in's result shows which it saw.
    v, u = np.indices((10, 10))
    levels = np.where((v % 2 == 0) & (u % 2 == 0), 40, 200).astype(np.uint8)
    views = np.broadcast_to(levels[..., None, None, None], (10, 10, 12, 12, 3)).copy()
    made = score._upscale_light_field(StandIn(), views, (4, 4), is_light_field)
    saw_only_dark = int(made.max()) == 40
    assert saw_only_dark == is_light_field


def test_a_view_that_the_fallback_made_alone_is_recognized():
    """Also where it doesn't fit the view, and is averaged with interpolation."""
    views = np.random.default_rng(0).integers(0, 256, (1, 1, 24, 24, 3), np.uint8)
    case = SimpleNamespace(views=views, at=(0, 0))
    network = catalogue.load_upscaler("fast")
    single = upscale_pixels(network, views[0])[0]
    made, share = _upscale_single(network, views[0, 0], skip=True, averages_misfits=True)
    assert share > 0
    assert score._is_alone(round_to_depth(made, np.dtype(np.uint8)), single, case)
    assert not score._is_alone(single, single, case)
