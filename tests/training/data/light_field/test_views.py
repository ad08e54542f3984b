"""Folders of views for validation and evaluation: reading, degrading and errors."""

import numpy as np
import pytest
from PIL import Image

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.layout import Layout
from ciir.training.data.downscale import KINDS, downscale_picture
from ciir.training.data.light_field.views import LEAST, degrade_views, read_views


def views(down, across, height=LEAST, width=LEAST + 2):
    return np.random.default_rng(0).integers(0, 256, (down, across, height, width, 3), np.uint8)


def save(folder, pixels, name="view_{v:02d}_{u:02d}"):
    folder.mkdir()
    for v, row in enumerate(pixels):
        for u, picture in enumerate(row):
            Image.fromarray(picture).save(folder / f"{name.format(v=v, u=u)}.png")
    return folder


def test_views_are_placed_by_their_names(tmp_path):
    pixels = views(3, 4)
    np.testing.assert_array_equal(read_views(save(tmp_path / "a", pixels)), pixels)


@pytest.mark.parametrize(("grid", "part"), [((3, 3), np.s_[1:4, 1:4]), ((1, 2), np.s_[2:3, 1:3])])
def test_the_middle_ones_of_more(tmp_path, grid, part):
    pixels = views(5, 5)
    np.testing.assert_array_equal(read_views(save(tmp_path / "a", pixels), grid=grid), pixels[part])


def test_16_bits_of_which_10_are_used_keep_8(tmp_path):
    """Else they had 2, and scores of 60 dB."""
    pixels = views(3, 3)
    pixels[0, 0, 0, 0] = 255
    LightField(pixels.astype(np.uint16) * 4, depth_sense="cameras").save(tmp_path / "a.npy")
    np.testing.assert_allclose(read_views(tmp_path / "a.npy"), pixels.astype(int), atol=1)


def test_grey_views_become_rgb(tmp_path):
    pixels = views(2, 2)[..., 0]
    found = read_views(save(tmp_path / "a", pixels))
    np.testing.assert_array_equal(found, pixels[..., None].repeat(3, axis=-1))
    assert found.flags.c_contiguous


@pytest.mark.parametrize("kind", KINDS)
def test_each_view_is_degraded_as_a_photograph(kind):
    pixels = views(2, 3, 19, 26)
    low, high = degrade_views(pixels, kind, 2)
    for v in range(2):
        for u in range(3):
            wanted = downscale_picture(kind, pixels[v, u], 2)
            np.testing.assert_array_equal(low[v, u], wanted.low)
            np.testing.assert_array_equal(high[v, u], wanted.high)


def refused(folder, **options):
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the tests check the message
        read_views(folder, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.count(str(folder)) == 1
    assert message.startswith(f"{folder}: ")
    return message


def test_names_without_a_position(tmp_path):
    """The error does not name the option `pixels`, which only reconstruction has."""
    message = refused(save(tmp_path / "a", views(1, 5), name="picture{u}x"))
    assert "5 pictures without rows and columns in their names" in message
    assert message.endswith("name all views view_VV_UU.png by row and column, and remove other pictures")
    assert "give pixels" not in message


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda a: (a / "view_01_01.png").unlink(), "no view \\(1, 1\\); add it"),
        (lambda a: (a / "view_01_01.png").write_bytes(b"x"), "view_01_01.png: not a picture"),
        (lambda a: Image.new("RGB", (9, 9)).save(a / "view_01_01.png"), "make all views alike"),
        (lambda a: [path.unlink() for path in a.iterdir()], "no files in it"),
        (lambda a: [path.unlink() for path in a.iterdir() if "00_00" not in path.name], "not a set of views; name"),
    ],
)
def test_errors_name_the_folder(tmp_path, damage, message):
    folder = save(tmp_path / "a", views(2, 3))
    damage(folder)
    with pytest.raises(ValueError, match=message):
        read_views(folder)
    refused(folder)


def test_no_folder(tmp_path):
    assert "no such folder or file; name a light field" in refused(tmp_path / "gone")


def test_other_files(tmp_path):
    """16 bits are rounded to 8; a picture needs its lenses."""
    pixels = views(2, 3)
    np.save(tmp_path / "deep.npy", pixels.astype(np.uint16) * 257 - np.uint16(100) * (pixels > 0))
    np.testing.assert_array_equal(read_views(tmp_path / "deep.npy"), pixels)
    Image.fromarray(LightField(pixels).eia()).save(tmp_path / "eia.png")
    np.testing.assert_array_equal(read_views(tmp_path / "eia.png", layout=Layout(pixels=(2, 3))), pixels)
    advice = "give a folder of views, which `ciir convert eia.png -o FOLDER` makes; see ciir convert --help"
    assert refused(tmp_path / "eia.png").endswith(f": a picture is read as an elemental image array; {advice}")
    np.save(tmp_path / "five.npy", views(1, 5)[0])
    assert "5 views, which is not a square number; give a folder of views" in refused(tmp_path / "five.npy")
    given = Layout(lenses=(7, 7))
    assert "ciir convert" not in refused(tmp_path / "eia.png", layout=given)  # the command has the options


def test_views_too_small_or_of_an_unsupported_type(tmp_path):
    small = f"views of {LEAST - 1}x{LEAST} pixels; at least {LEAST}x{LEAST} are needed: name larger views"
    assert small in refused(save(tmp_path / "small", views(3, 3, LEAST - 1, LEAST)))
    clear = np.concatenate([views(2, 2), views(2, 2)[..., :1]], axis=-1)
    assert "views of 4 channels, not all opaque; give grey or RGB" in refused(save(tmp_path / "clear", clear))
