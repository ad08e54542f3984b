import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.displays.quilt import QuiltLayout, split_quilt
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from tests.support.light_fields import make_views

FIELD = LightField(make_views((3, 48), disparities=(0, 0), side=8, channels=3), depth_sense="cameras")


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_the_middle_row_becomes_a_quilt(tmp_path, suffix):
    notes = FIELD.save(tmp_path / f"a{suffix}", "quilt")
    quilt = decode((tmp_path / f"a{suffix}").read_bytes(), name="a")
    assert np.array_equal(split_quilt(quilt, QuiltLayout(8, 6, 1.0), name="a"), FIELD.views[1])
    assert notes == (
        "views keep their aspect 1, not the device's 0.75; name the device for black borders that fill it",
        "quilt: name it NAME_qs8x6a1.png; displays read columns, rows and aspect there",
    )


def test_for_a_device_views_get_its_aspect(tmp_path):
    notes = FIELD.save(tmp_path / "a.png", "quilt", device="65")
    assert decode((tmp_path / "a.png").read_bytes(), name="a").shape == (9 * 8, 8 * 14, 3)
    assert notes[0] == "72 views are interpolated from the 48 of the middle row"


def test_an_unknown_device_is_refused_before_any_work(tmp_path):
    with pytest.raises(InvalidOption, match="device: 'phone' is not known"):
        FIELD.save(tmp_path / "a.png", "quilt", device="phone")
    assert not list(tmp_path.iterdir())
