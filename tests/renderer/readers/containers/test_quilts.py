import numpy as np
import pytest
from PIL import Image, ImageCms

from ciir.errors import InvalidOption
from ciir.renderer.displays.quilt import QuiltLayout, join_views
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read
from ciir.renderer.readers.layout import Layout
from ciir.renderer.writers.pictures import encode

LAYOUT = QuiltLayout(3, 2, 0.5)
VIEWS = np.random.default_rng(0).integers(0, 256, (6, 8, 4, 3), np.uint8)


def write(folder, name, beside=None):
    path = folder / name
    path.write_bytes(encode(join_views(VIEWS, LAYOUT), path.suffix))
    if beside is not None:
        (folder / f"{name}.json").write_text(beside)
    return Bundle.from_path(path)


@pytest.mark.parametrize(
    ("name", "beside"), [("a_qs3x2a0.5.png", None), ("a.tif", LAYOUT.to_json()), ("a_qs3x2a0.5.png", "{}")]
)
def test_the_name_or_the_json_beside_it_gives_the_layout(tmp_path, name, beside):
    found = read(write(tmp_path, name, beside))
    assert found.depth_sense == "cameras"
    assert np.array_equal(found.views, VIEWS[None])
    assert found.notes == ("read as a quilt of 3 columns and 2 rows of views",)


def test_json_beside_a_named_quilt_says_that_views_are_inverted(tmp_path):
    inverted = LAYOUT.to_json().replace("false", "true")
    found = read(write(tmp_path, "a_qs3x2a0.5.png", inverted))
    assert np.array_equal(found.views, VIEWS[None, ::-1])
    assert found.notes[1] == "its JSON says invertViews: the views are put from left to right"
    other = read(write(tmp_path, "b_qs3x2a0.5.png", inverted.replace('"viewX": 3', '"viewX": 4')))
    assert np.array_equal(other.views, VIEWS[None])


def test_a_colour_profile_that_is_not_srgb_is_noted(tmp_path):
    path = tmp_path / "a_qs3x2a0.5.png"
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("XYZ")).tobytes()
    Image.fromarray(join_views(VIEWS, LAYOUT)).save(path, icc_profile=profile)
    assert "is not sRGB and is left out; convert to sRGB first" in read(Bundle.from_path(path)).notes[-1]


def test_pixels_that_are_not_square_are_noted(tmp_path):
    found = read(write(tmp_path, "a_qs3x2a0.75.png"))
    assert "shown with the aspect 0.75: pixels are not square" in found.notes[1]
    assert found.pixel_aspect * VIEWS.shape[2] / VIEWS.shape[1] == pytest.approx(0.75)


def test_without_an_aspect_pixels_are_square(tmp_path):
    found = read(write(tmp_path, "a_qs3x2.png"))
    assert np.array_equal(found.views, VIEWS[None])
    assert found.pixel_aspect == 1.0
    assert found.notes[1] == "the name has no aspect: pixels are taken as square"


def test_an_aspect_that_a_name_lacks_is_in_the_json_beside_it(tmp_path):
    beside = QuiltLayout(3, 2, 0.75).to_json()
    assert read(write(tmp_path, "a_qs3x2.png", beside)).pixel_aspect == 1.5
    assert read(write(tmp_path, "b_qs2x3.png", beside)).pixel_aspect == 1.0


def test_an_upload_has_its_layout_in_its_name():
    data = encode(join_views(VIEWS, LAYOUT), ".png")
    assert read(Bundle.from_upload("a_qs3x2a0.5.png", data)).views.shape[:2] == (1, 6)


def test_the_options_of_an_elemental_image_array_read_one(tmp_path):
    found = read(write(tmp_path, "a_qs3x2a0.5.png"), Layout(lenses=(8, 6), arrangement="eia"))
    assert found.views.shape == (2, 2, 8, 6, 3)
    assert found.depth_sense == "lenses"


def test_json_of_something_else_makes_no_quilt(tmp_path):
    with pytest.raises(InvalidOption, match="a picture is read as an elemental image array"):
        read(write(tmp_path, "a.png", "[1]"))


def test_a_layout_that_does_not_fit_is_refused(tmp_path):
    with pytest.raises(InvalidOption, match=r"12x16 pixels \(width x height\) are too few for 20x2 views"):
        read(write(tmp_path, "a_qs20x2a0.5.png"))
    with pytest.raises(InvalidOption, match="quilt: 99x2 is out of range"):
        read(write(tmp_path, "a_qs99x2a0.5.png"))
