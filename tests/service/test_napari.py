"""The plugin for napari; parts that need npe2 or napari (`pip install '.[napari]'`) are skipped without them.

With them: `pytest -p no:napari -p no:npe2 -p no:napari-plugin-engine`, as their plugins of pytest load numpy too early.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from ciir.renderer.light_field import LightField
from ciir.service import napari as plugin
from tests.support.paths import ROOT

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # napari's and npe2's own, of pydantic
MANIFEST = ROOT / "ciir" / "napari.yaml"
SHAPE = (3, 5, 24, 32)


def make_field(channels=3, disparity=1):
    """A plane of random pixels that moves to the left by whole pixels from view to view."""
    wide = np.random.default_rng(0).integers(0, 256, (SHAPE[2] + 8, SHAPE[3] + 8, channels), np.uint8)
    views = [
        [wide[4 + disparity * v :, 4 + disparity * u :][: SHAPE[2], : SHAPE[3]] for u in range(-2, 3)]
        for v in range(-1, 2)
    ]
    return LightField(np.array(views), ("a note",), depth_sense="cameras")


def make_image(field):
    data, shown, kind = plugin.make_layer(field, "field")
    assert kind == "image"
    return SimpleNamespace(data=data, rgb=shown["rgb"], name=shown["name"], metadata=shown["metadata"])


@pytest.fixture
def path(tmp_path):
    make_field().save(tmp_path / "field.npz")
    return str(tmp_path / "field.npz")


def test_reads_a_light_field_as_one_layer(path):
    ((data, shown, kind),) = plugin.get_reader(path)(path)
    assert data.shape == (*SHAPE, 3)
    assert kind == "image"
    assert (shown["name"], shown["rgb"], shown["axis_labels"]) == ("field", True, ("v", "u", "y", "x"))
    assert shown["metadata"]["depth_sense"] == "cameras"
    assert plugin.get_reader([path]) is None


def test_grey_views_have_no_channels():
    for channels in (1, 2):
        data, shown, _ = plugin.make_layer(make_field(channels), "grey")
        assert (data.shape, shown["rgb"]) == (SHAPE, False)


def test_disparity_is_larger_where_it_is_nearer():
    field = make_field()
    for given in (field, field.with_depth_sense("lenses")):
        (found, _, _), (confidence, shown, _) = plugin.find_disparity(make_image(given))
        assert np.median(found) == pytest.approx(1, abs=0.1)
        assert confidence.shape == found.shape
        assert not shown["visible"]


def test_planes_are_the_same_at_every_view():
    field = make_field()
    for given in (field, field.with_depth_sense("lenses")):
        planes, shown, _ = plugin.make_planes(make_image(given), least=-1, largest=1, number=3)
        assert planes.shape == (3, *SHAPE, 3)
        assert shown["metadata"]["disparities"] == [-1, 0, 1]
        sharp = planes[2, 0, 0, 4:-4, 4:-4].astype(int)
        assert np.abs(sharp - field.view(1, 2)[4:-4, 4:-4]).max() <= 1


def test_elemental_images_are_opened_with_their_lenses(tmp_path):
    make_field().with_depth_sense("lenses").save(tmp_path / "eia.png")
    data, _, _ = plugin.open_elemental_images(tmp_path / "eia.png", SHAPE[2], SHAPE[3])
    assert data.shape == (*SHAPE, 3)


def test_the_manifest_names_what_is_there():
    npe2 = pytest.importorskip("npe2", reason="npe2 is not installed: pip install '.[napari]'")
    manifest = npe2.PluginManifest.from_file(MANIFEST)
    manifest.validate_imports()
    assert {command.id for command in manifest.contributions.commands} == {
        contribution.command for contribution in (*manifest.contributions.readers, *manifest.contributions.widgets)
    }


def test_napari_shows_sliders_for_v_and_u(path):
    components = pytest.importorskip("napari.components", reason="napari is not installed: pip install '.[napari]'")
    npe2 = pytest.importorskip("npe2", reason="npe2 is not installed: pip install '.[napari]'")
    manager = npe2.PluginManager.instance()
    if "ciir" not in manager:
        manager.register(npe2.PluginManifest.from_file(MANIFEST))
    viewer = components.ViewerModel()
    (layer,) = viewer.open(path, plugin="ciir")
    assert layer.rgb
    assert viewer.dims.axis_labels == ("v", "u", "y", "x")
    assert viewer.dims.nsteps[:2] == SHAPE[:2]
    for layer_data in plugin.find_disparity(layer):
        viewer._add_layer_from_data(*layer_data)
    assert len(viewer.layers) == 3
