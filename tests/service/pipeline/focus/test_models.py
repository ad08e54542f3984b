import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.service.pipeline.focus.models import build_model
from ciir.service.pipeline.options import KINDS

MESH = {"lenses": "24x24", "pixels": "5x5", "backend": "raytrace", "pitch": "0.5", "delta": "0.1"}


def build(source, **texts):
    return build_model(source, KINDS["disparity"].parse(texts))


def test_it_has_the_lens_array_of_the_input():
    model, report = build("vase", **MESH)
    assert (model.array.pitch, model.array.delta, model.array.rows) == (0.5, 0.1, 24)
    assert report["surface"] == {"vertices": len(model.vertices), "triangles": len(model.faces)}
    assert report["notes"] == []
    assert {"render", "focus", "total"} <= set(report["timings_ms"])


def test_after_upscaling_it_lies_where_it_did():
    small, _ = build("vase", **MESH)
    large, _ = build("vase", **MESH, model="nearest")
    assert (large.array.rows, large.array.pitch) == (48, 0.25)
    # Pixels of 0.5 and 0.25; the median of depths is not moved by outliers at outlines.
    np.testing.assert_allclose(np.median(large.vertices, axis=0), np.median(small.vertices, axis=0), atol=0.5)


@pytest.mark.parametrize("name", ["view", "limits"])
def test_options_of_maps_are_refused(name):
    with pytest.raises(InvalidOption, match=f"{name}: a model is made of several views"):
        build(LightField(np.zeros((3, 3, 8, 8, 3), np.uint8)), **{name: {"view": "0,0", "limits": "0:1"}[name]})
