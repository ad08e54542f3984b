import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.pictures import decode
from ciir.service.pipeline.elemental import encode_eia, render_eia
from ciir.service.pipeline.options import Options
from tests.support.inputs import EIA, EIA_PNG
from tests.support.pipeline import SMALL, eia_bundle, run


def test_elemental_then_mapping_equals_rendering(cube):
    kept, counts = [], []
    report = render_eia(cube, Options(**SMALL), kept.append, progress=lambda *count: counts.append(count))
    (eia,) = kept
    assert counts == [(done, 15) for done in range(1, 16)]
    assert eia.shape == (36, 50, 3)
    mapped, _ = run(eia_bundle(eia), lenses=(12, 10), views="all", model="none")
    rendered, whole = run(cube, views="all", model="none", **SMALL)
    assert mapped.keys() == rendered.keys()
    assert all(np.array_equal(mapped[view], rendered[view]) for view in mapped)
    assert len(np.unique(eia)) > 2  # there is something to see
    assert report["scene_transform"] == whole["scene_transform"]
    assert report["lens_array"] == whole["lens_array"]
    assert set(report["timings_ms"]) == {"decode", "render", "encode", "total"}


def test_an_optical_elemental_image_array(cube):
    kept = []
    for pickup in ("virtual", "optical"):
        render_eia(cube, Options(**SMALL, pickup=pickup), kept.append)
    assert not np.array_equal(*kept)
    assert np.array_equal(LightField.from_eia(kept[1], rows=12, cols=10, pickup="optical").eia(), kept[0])


@pytest.mark.parametrize("pickup", ["virtual", "optical"])
def test_its_png_is_read_without_options(cube, pickup):
    options, kept = Options(**SMALL, pickup=pickup), []
    render_eia(cube, options, kept.append)
    found = inputs.read(Bundle.from_upload("eia.png", encode_eia(kept[0], options)))
    assert found.notes == ()
    assert np.array_equal(found.eia(pickup=pickup), kept[0])
    assert np.array_equal(decode(encode_eia(kept[0], options, ".tif"), name="a.tif"), kept[0])


def test_elemental_wants_a_mesh():
    for source in (eia_bundle(EIA), Bundle("set", None, {"view_00_00.png": EIA_PNG})):
        for options in (Options(), Options(lenses=(50, 50)), Options(pixels=(3, 3))):
            with pytest.raises(
                InvalidOption, match=r"holds pictures; give a mesh \(`ciir convert` writes the elemental"
            ):
                render_eia(source, options, pytest.fail)


def test_an_elemental_image_array_without_the_object_is_noted(cube):
    assert render_eia(cube, Options(**SMALL), lambda _: None)["notes"] == []
    # Rays run along the diagonals almost within the array's plane; no lens of 12x9 stands on a diagonal.
    wide = Options(**(SMALL | {"lenses": (12, 9), "pixels": (2, 2)}), delta=1e9)
    assert "shows the object" in render_eia(cube, wide, lambda _: None)["notes"][0]
