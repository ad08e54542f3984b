import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode

FIELD = LightField(np.random.default_rng(0).integers(0, 65535, (2, 3, 4, 5, 3), np.uint16))


def saved(path, name, **options):
    FIELD.save(path, name, **options)
    return decode(path.read_bytes(), name="x")


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_the_elemental_image_array(tmp_path, suffix):
    eia = saved(tmp_path / f"a{suffix}", "eia")
    for v, u, y, x in np.ndindex(FIELD.views.shape[:4]):
        assert (eia[y * 2 + v, x * 3 + u] == FIELD.view(v, u)[y, x]).all()


def test_epi_rows(tmp_path):
    middle = saved(tmp_path / "a.png", "epi")
    named = saved(tmp_path / "a.png", "epi", epi="y=3,v=0")
    assert middle.shape == named.shape == (3, 5, 3)
    for u, x in np.ndindex(3, 5):
        assert (middle[u, x] == FIELD.view(1, u)[2, x]).all()
        assert (named[u, x] == FIELD.view(0, u)[3, x]).all()


def test_epi_columns(tmp_path):
    middle = saved(tmp_path / "a.png", "epi", epi="x=4")
    named = saved(tmp_path / "a.png", "epi", epi="x=0,u=2")
    assert middle.shape == named.shape == (4, 2, 3)
    for y, v in np.ndindex(4, 2):
        assert (middle[y, v] == FIELD.view(v, 1)[y, 4]).all()
        assert (named[y, v] == FIELD.view(v, 2)[y, 0]).all()


@pytest.mark.parametrize(
    ("epi", "message"),
    [("y=4", "no y=4; give 0 to 3"), ("y=1,v=2", "no v=2; give 0 to 1"), ("x=5", "no x=5"), ("7", "not understood")],
)
def test_lines_that_are_not_there(tmp_path, epi, message):
    with pytest.raises(InvalidOption, match=message):
        FIELD.save(tmp_path / "a.png", "epi", epi=epi)
    assert list(tmp_path.iterdir()) == []


def test_pixels_that_the_picture_format_cannot_hold(tmp_path):
    with pytest.raises(InvalidOption, match="JPEG holds 8-bit"):
        FIELD.save(tmp_path / "a.jpg", "eia")


def test_the_name_must_fit_the_format(tmp_path):
    with pytest.raises(InvalidOption, match=r"eia is written as \.png or .*; end the name with that"):
        FIELD.save(tmp_path / "a.npy", "eia")
    with pytest.raises(
        InvalidOption, match=r"'png' is one picture, without the other views; give folder, zip, npz, .*eia"
    ):
        FIELD.save(tmp_path / "a.png", "png")
    with pytest.raises(InvalidOption, match=r"a folder of views has no suffix; leave \.zip out, or the format"):
        FIELD.save(tmp_path / "a.zip", "folder")
