import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import Layout


def light_field(channels=3, dtype=np.uint8):
    views = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (3, 4, 6, 5, channels), dtype, endpoint=True)
    return LightField(views)


def read(path, **options):
    options = {"lenses": None, "pixels": None} | options
    return inputs.read(Bundle.from_path(path), Layout(**options))


@pytest.mark.parametrize("name", ["eia.png", "eia.TIF"])
@pytest.mark.parametrize(("channels", "dtype"), [(1, np.uint8), (4, np.uint16)])
def test_a_picture_is_the_elemental_image_array(tmp_path, name, channels, dtype):
    field = light_field(channels, dtype)
    field.save(tmp_path / name)
    np.testing.assert_array_equal(read(tmp_path / name, lenses=(6, 5)).views, field.views)


@pytest.mark.parametrize(("name", "format_"), [("views", None), ("views.zip", None), ("views.v1", "folder")])
def test_views_are_read_again(tmp_path, name, format_):
    field = light_field()
    field.save(tmp_path / name, format_)
    np.testing.assert_array_equal(read(tmp_path / name).views, field.views)


def test_npz(tmp_path):
    field = light_field()
    field.save(str(tmp_path / "views.npz"))
    with np.load(tmp_path / "views.npz") as arrays:
        np.testing.assert_array_equal(arrays["views"].reshape(field.views.shape), field.views)


@pytest.mark.parametrize("name", ["views.bmp", "eia.jpg"])
def test_what_cannot_be_written_leaves_nothing(tmp_path, name):
    with pytest.raises(InvalidOption, match=r"JPEG holds 8-bit|can't be written"):
        light_field(4, np.uint16).save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
