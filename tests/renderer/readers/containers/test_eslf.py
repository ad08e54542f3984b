import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers.eslf import is_eslf
from ciir.renderer.readers.layout import Layout
from ciir.renderer.writers.pictures import encode, encode_png
from tests.support.inputs import make_png_header

LENSES = (6, 8)


def make(kept, channels=3, weight=None):
    """An ESLF picture, pixel by pixel: views outside `kept` = (top, bottom, left, right) are black."""
    top, bottom, left, right = kept
    picture = np.zeros((14 * LENSES[0], 14 * LENSES[1], channels), np.uint16)
    for y, x, v, u in np.ndindex(*LENSES, 14, 14):
        if top <= v < bottom and left <= u < right:
            picture[14 * y + v, 14 * x + u, :3] = 20_000 + 2000 * v + 100 * u + 10 * y + x
            if channels == 4:
                picture[14 * y + v, 14 * x + u, 3] = weight
    return picture


def read(picture, name="IMG_1085_eslf.png", **layout):
    return inputs.read(Bundle.from_upload(name, encode_png(picture)), Layout(order="given", **layout))


@pytest.mark.parametrize("kept", [(0, 14, 0, 14), (3, 11, 2, 13), (6, 7, 4, 7), (5, 12, 6, 7), (7, 8, 6, 7)])
def test_views_lie_under_each_lens(kept):
    top, bottom, left, right = kept
    found = read(make(kept))
    assert found.views.shape == (bottom - top, right - left, *LENSES, 3)
    for v, u, y, x in np.ndindex(found.views.shape[:4]):
        assert found.view(v, u)[y, x, 0] == 20_000 + 2000 * (v + top) + 100 * (u + left) + 10 * y + x
    assert found.depth_sense == "cameras"
    left = f"{bottom - top}x{right - left} views from ({top}, {left}) are read"
    noted = [f"of the 14x14 views those on the margin are empty: {left}"]
    assert list(found.notes) == ([] if kept == (0, 14, 0, 14) else noted)


def test_a_round_pupil_leaves_a_full_grid():
    picture = make((0, 14, 0, 14))
    for v, u in np.ndindex(14, 14):
        if np.hypot(v - 6.5, u - 6.5) > 6.6:
            picture[v::14, u::14] = 0
    found = read(picture)
    rows, columns = found.views.shape[:2]
    assert (found.views.reshape(rows * columns, -1).max(axis=1) > 0).all()
    assert rows * columns >= 81  # the largest square in that circle has 9.3 views a side


def test_the_weight_is_left_out_and_says_which_views_are_empty():
    found = read(make((4, 12, 4, 12), channels=4, weight=65535))
    assert found.views.shape == (8, 8, *LENSES, 3)
    assert "weight, not alpha" in found.notes[0]


def test_views_without_light_are_empty_although_their_weight_is_not():
    picture = make((4, 12, 4, 12), channels=4, weight=0)
    picture[..., 3] = 65535
    assert read(picture).views.shape == (8, 8, *LENSES, 3)


def test_the_last_lenses_may_lack_pixels():
    found = read(make((3, 11, 3, 11))[:-2, :-1])
    assert found.views.shape == (8, 8, *LENSES, 3)
    assert found.view(7, 7)[5, 7, 0] == 20_000 + 2000 * 10 + 100 * 10 + 57


def test_other_lenses_can_be_given():
    picture = np.full((30, 45, 3), 9, np.uint8)
    assert read(picture, pixels=(15, 15)).views.shape == (15, 15, 2, 3, 3)


def test_it_is_recognised_by_its_name_or_the_size_of_the_illum():
    assert is_eslf("a_ESLF.PNG", make_png_header(10, 10))
    assert is_eslf("upload.png", make_png_header(376 * 14, 541 * 14))
    assert not is_eslf("upload.png", make_png_header(541 * 14, 376 * 14))
    assert read(make((3, 11, 3, 11)), pixels=(14, 14), arrangement="eia").views.shape == (14, 14, *LENSES, 3)
    with pytest.raises(InvalidOption, match="elemental image array"):
        read(make((0, 14, 0, 14)), "a.png")


@pytest.mark.parametrize("name", ["capture.png", "capture.tif"])
@pytest.mark.parametrize("channels", [3, 4])
def test_it_is_recognised_under_another_name_by_its_empty_corners(name, channels):
    picture = make((3, 11, 3, 11), channels, weight=65535)
    for layout in ({"pixels": (14, 14)}, {"lenses": LENSES}):
        data = encode(picture, name[-4:])
        found = inputs.read(Bundle.from_upload(name, data), Layout(order="given", **layout))
        assert found.views.shape == (8, 8, *LENSES, 3)
        assert found.depth_sense == "cameras"
        assert "8x8 views from (3, 3) are read" in found.notes[-2]
        assert "arrangement eia reads it as an elemental image array of a lens array" in found.notes[-1]
    black = np.zeros_like(picture)
    for other in (make((0, 14, 0, 14)), black):
        found = read(other, "capture.png", pixels=(14, 14))
        assert (found.views.shape[:2], found.depth_sense) == ((14, 14), "lenses")


@pytest.mark.parametrize("sense", ["lenses", "cameras"])
def test_our_own_is_exact(tmp_path, sense):
    views = np.random.default_rng(1).integers(9, 2**16, (3, 4, 5, 7, 3), np.uint16)
    field = LightField(views, depth_sense=sense)
    notes = field.save(tmp_path / "a_eslf.png", "eslf")
    found = inputs.read(Bundle.from_path(tmp_path / "a_eslf.png"), Layout(order="given"))
    np.testing.assert_array_equal(found.with_depth_sense(sense).views, views)
    assert ["reversed" in note for note in notes] == [True] * (sense == "lenses")


def test_what_eslf_cannot_hold():
    with pytest.raises(InvalidOption, match="up to 14x14 views, not 15x2; give format eia"):
        LightField(np.zeros((15, 2, 4, 4, 3), np.uint8)).save("a.png", "eslf")
