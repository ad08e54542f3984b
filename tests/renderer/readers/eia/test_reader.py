"""Pictures of all views: their margins, what they are, and the numbers that would fit."""

import re

import numpy as np
import pytest

import ciir
from ciir.errors import InvalidOption
from ciir.renderer.displays.quilt import QuiltName, parse_name
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.eia.advice import RAW, advise_quilt
from ciir.renderer.readers.layout import TEXT, Layout, write_text
from ciir.renderer.writers.pictures import encode_png, png
from tests.renderer.readers.eia.test_period import make_mosaic
from tests.support.light_fields import make_views
from tests.support.paths import SHARED

VIEWS = make_views((5, 7), side=60, disparities=(-1, 1), channels=3)
EIA, MOSAIC = LightField(VIEWS).eia(), make_mosaic(VIEWS)


@pytest.fixture(scope="module")
def vase():
    """An elemental image array of 50x50 lenses of 9x9 pixels."""
    return ciir.render("scene:vase", lenses=(50, 50), pixels=(9, 9), backend="raytrace").eia()


def read(picture, **layout):
    return inputs.read(Bundle("a.png", "a.png", {"a.png": encode_png(picture)}), Layout(**layout))


def message(picture, **layout):
    with pytest.raises(InvalidOption) as caught:
        read(picture, **layout)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def read_png(picture, text, **layout):
    bundle = Bundle("a.png", "a.png", {"a.png": png.encode(picture, {TEXT: text})})
    return inputs.read(bundle, Layout(**layout))


OWN = write_text("eia", (5, 7, 60, 60), "optical")


@pytest.mark.parametrize("layout", [{}, {"pixels": (5, 7)}, {"lenses": (60, 60)}])
def test_what_the_text_of_a_png_says_of_its_views(layout):
    field = read_png(EIA, OWN, **layout)
    assert np.array_equal(field.eia(pickup="optical"), EIA)
    assert (field.notes, field.depth_sense) == ((), "lenses")


@pytest.mark.parametrize("written", ["virtual", "optical"])
@pytest.mark.parametrize(
    ("given", "layout"),
    [(None, {}), ("virtual", {}), ("optical", {}), ("virtual", {"arrangement": "eia", "lenses": (60, 60)})],
)
def test_a_pickup_that_is_given_wins_with_a_note(written, given, layout):
    field = read_png(EIA, write_text("eia", (5, 7, 60, 60), written), pickup=given, **layout)
    assert np.array_equal(field.eia(pickup=given or written), EIA)
    note = f"pickup: the file's own text says {written}; it is read as {given}, as given"
    assert field.notes == (() if given in (None, written) else (note,))


def test_other_options_and_sizes_than_the_text_of_a_png_has():
    assert read_png(MOSAIC, OWN, arrangement="mosaic", pixels=(5, 7)).depth_sense == "cameras"
    assert read_png(EIA, OWN, pixels=(10, 7)).views.shape[:2] == (10, 7)
    turned = read_png(EIA, write_text("eia", (5, 7, 60, 60)), pickup="optical")
    assert np.array_equal(turned.eia(pickup="optical"), EIA)
    assert read_png(EIA, OWN, pixels=(5, 7), crop=(5, 0, 0, 0)).views.shape[:4] == (5, 7, 59, 60)
    for text in (write_text("eia", (5, 7, 60, 61)), "eia", "", OWN + "\n", OWN.replace("eia", "views")):
        with pytest.raises(InvalidOption, match="give the number of lenses"):
            read_png(EIA, text)


@pytest.mark.parametrize("layout", [{"pixels": (5, 7)}, {"lenses": (60, 60)}])
def test_a_mosaic_is_read_as_what_it_is(layout):
    field = read(MOSAIC, **layout)
    assert np.array_equal(field.views, VIEWS)
    assert field.depth_sense == "cameras"
    assert field.notes[0] == (
        "arrangement: the picture repeats about every 60x60 pixels, so it is read as a mosaic of 5x7 views; if it is a "
        "quilt, name it NAME_qs7x5a1.png, or put its NAME.png.json next to it; if it is an elemental image array, give "
        "arrangement eia"
    )
    sure = read(MOSAIC, arrangement="mosaic", **layout)
    assert np.array_equal(sure.views, VIEWS)
    assert sure.notes == ()


def test_an_elemental_image_array_stays_one_and_either_can_be_asked_for():
    field = read(EIA, pixels=(5, 7))
    assert np.array_equal(field.views, VIEWS)
    assert (field.notes, field.depth_sense) == ((), "lenses")
    asked = read(MOSAIC, pixels=(5, 7), arrangement="eia", order="given")
    assert np.array_equal(asked.eia(), MOSAIC)
    assert asked.notes == ()
    optical = read(MOSAIC, pixels=(5, 7), pickup="optical", order="given")
    assert np.array_equal(optical.eia(pickup="optical"), MOSAIC)


def test_the_order_of_a_mosaic_is_put_right():
    field = read(make_mosaic(VIEWS[::-1]), pixels=(5, 7))
    assert np.array_equal(field.views, VIEWS)
    assert field.notes[1].startswith("order: rows of views are taken from the bottom up")


def test_a_picture_that_shows_another_period_or_none_is_noted(vase):
    (note,) = read(vase, lenses=(75, 75), order="given").notes
    assert note == (
        "arrangement: read as elemental images of 6x6 pixels, but the picture repeats about every 8x9 pixels, which "
        f"doesn't divide it as elemental images would (pixels 9x9 or 10x10); {RAW}; give lenses and pixels that match "
        "it, or arrangement mosaic for views side by side"
    )
    noise = np.random.default_rng(0).integers(0, 256, (120, 120, 3), np.uint8)
    (note,) = read(noise, pixels=(12, 12), order="given").notes
    assert "12x12 pixels, which the picture doesn't show clearly" in note


def test_pixels_given_as_lenses_are_noted(vase):
    (note,) = read(vase, lenses=(9, 9), order="given").notes
    assert note == (
        "lenses: read as 9x9 lenses of 50x50 pixels, but the picture repeats about every 8x9 pixels; if 9x9 are the "
        "pixels of an elemental image, give pixels 9x9"
    )
    assert read(vase, lenses=(9, 9), order="given", arrangement="eia").notes == ()
    assert read(vase, lenses=(50, 50), order="given").notes == ()


@pytest.mark.parametrize(
    ("pixels", "words"),
    [
        (15, "every 13x13 pixels, which doesn't divide it as elemental images would (pixels 12x12 or 15x15); give"),
        (11, "every 10x10 pixels, the size of an elemental image (pixels 10x10 or 11x11 or 12x12) or of a view of a"),
    ],
)
def test_sizes_that_parallax_may_have_changed_are_named_too(pixels, words):
    eia = ciir.render("scene:globe", lenses=(60, 60), pixels=(pixels, pixels), backend="raytrace").eia()
    assert f"the picture repeats about {words}" in message(eia)


def test_a_period_that_divides_the_picture_is_named_though_squares_fit_about_as_well():
    eia = LightField(make_views((7, 9), side=48)).eia()
    assert "repeats about every 7x9 pixels, the size of an elemental image (pixels 7x9 or 8x8) or of" in message(eia)


def test_margins_are_cut_off():
    padded = np.pad(EIA, ((2, 3), (0, 4), (0, 0)))
    assert np.array_equal(read(padded, pixels=(5, 7), crop=(2, 0, 3, 4)).views, VIEWS)
    assert "crop: 100,0,300,0 leaves nothing of the picture of 305x424" in message(
        padded, pixels=(5, 7), crop=(100, 0, 300, 0)
    )


def test_numbers_that_do_not_fit_are_answered_with_those_that_would(vase):
    text = message(vase, lenses=(51, 49))
    assert text == (
        "lenses: 51x49 does not divide the picture of 450x450 pixels (rows x columns); the nearest that does is 50x50; "
        "give margins on all four sides as crop TOP,LEFT,BOTTOM,RIGHT: the size alone doesn't reveal them; the picture "
        "repeats about every 8x9 pixels, which doesn't divide it as elemental images would (pixels 9x9 or 10x10); "
        f"{RAW}"
    )
    text = message(vase, pixels=(8, 8))
    assert text.startswith("pixels: 8x8 does not divide the picture of 450x450 pixels")
    assert "; the nearest that does is 9x9; give margins on all four sides" in text
    assert "the nearest that does is 450x450; " in message(vase, lenses=(999, 999))
    assert "picture of 300x420 pixels (rows x columns); 5x7 (rows x columns) does; " in message(EIA, pixels=(7, 5))
    assert "3x4 lenses of 5x7 pixels do not make" in message(EIA, lenses=(3, 4), pixels=(5, 7))


def test_right_numbers_of_a_picture_with_margins_are_confirmed():
    array = np.tile(np.random.default_rng(0).integers(0, 255, (15, 15, 3), np.uint8), (20, 20, 1))
    text = message(np.pad(array, ((4, 7), (2, 0), (0, 0))), pixels=(15, 15))
    assert text == (
        "pixels: 15x15 does not divide the picture of 311x302 pixels (rows x columns); but it repeats every 15x15 "
        "pixels, so it has margins; give them as crop TOP,LEFT,BOTTOM,RIGHT"
    )


def test_without_numbers_the_period_of_the_picture_is_named(vase):
    text = message(vase)
    assert "as in pixels 15x15; the picture repeats about every 8x9 pixels, which doesn't divide it as" in text
    assert text.count("lens_pitch auto") == 1


def test_a_pitch_that_is_no_whole_number_is_not_called_the_size_of_elemental_images():
    """15x15 pixels divide a picture of 720x720 pixels, whether the pitch is 15 or 14.4."""

    def make_lenses(pitch):
        profile = np.sin(np.pi * np.arange(720) / pitch) ** 8
        return np.repeat(np.uint8(255 * np.outer(profile, profile))[..., None], 3, axis=2)

    whole = message(make_lenses(15))
    assert "every 15x15 pixels, the size of an elemental image (pixels 15x15) or of" in whole
    assert "quilt" not in whole
    for options in ({}, {"pixels": (14, 14)}, {"lenses": (51, 51)}):
        text = message(make_lenses(14.4), **options)
        assert text.endswith(f"; its lenses are 14.40 pixels apart: {RAW}")
        assert "repeats" not in text


def test_a_picture_that_shows_no_elemental_images_may_be_a_photo():
    photo = np.random.default_rng(0).integers(0, 256, (90, 120, 3), np.uint8)
    assert message(photo).endswith("; an ordinary photo is upscaled with `ciir upscale`")
    (note,) = read(photo, pixels=(9, 10)).notes
    assert note.endswith("; an ordinary photo is upscaled with `ciir upscale`")


def test_margins_are_not_guessed_from_the_size():
    padded = np.pad(EIA, ((11, 4), (7, 9), (0, 0)))
    text = message(padded, pixels=(5, 7))
    assert "give margins on all four sides as crop TOP,LEFT,BOTTOM,RIGHT: the size alone doesn't reveal them" in text
    assert "cut" not in text


@pytest.mark.parametrize("layout", [{"lenses": (25, 25)}, {"pixels": (18, 18)}, {"pixels": (9, 18)}])
def test_several_elemental_images_taken_for_one_are_noted(vase, layout):
    (note,) = read(vase, order="given", **layout).notes
    assert note.startswith("arrangement: read as elemental images of ")
    assert "but the picture repeats about every 8x9 pixels, which doesn't divide it as elemental images would" in note


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared")
@pytest.mark.parametrize(
    "layout", [{"lenses": (100, 100)}, {"pixels": (30, 30)}, {"pixels": (15, 60)}, {"pixels": (25, 25)}]
)
def test_wrong_numbers_for_a_real_elemental_image_array_are_noted(layout):
    """3000x3000 pixels: all of these divide it."""
    path = SHARED / "data/lightfields/eia-200x200x15.jpg"
    (note,) = ciir.open(path, order="given", **layout).notes
    assert "but the picture repeats about every 15x15 pixels, the size of an elemental image (pixels 15x15)" in note
    assert ciir.open(path, order="given", lenses=(200, 200)).notes == ()


@pytest.mark.parametrize("layout", [{}, {"arrangement": "mosaic"}, {"arrangement": "mosaic", "lenses": (59, 60)}])
def test_a_mosaic_is_named_where_its_numbers_are_missing_or_wrong(layout):
    text = message(MOSAIC, **layout)
    assert "the picture repeats every 60x60 pixels, as a mosaic of 5x7 views (rows x columns) does; " in text
    assert "give pixels 5x7" in text
    assert "lens_pitch" not in text
    assert ("arrangement eia and pixels 60x60" in text) is (layout == {})
    quilt = "does; if it is a quilt, name it NAME_qs7x5a1.png, or put its NAME.png.json next to it; otherwise give"
    assert (quilt in text) is (layout == {})


def test_a_mosaic_whose_period_does_not_show():
    noise = np.random.default_rng(0).integers(0, 256, (120, 120, 3), np.uint8)
    assert message(noise, arrangement="mosaic") == (
        "a.png: a mosaic is read by its rows and columns of views; give them, as in pixels 9x9"
    )


@pytest.mark.parametrize(
    ("pixels", "arrangement", "read_as"),
    [((10, 7), "mosaic", "10x7 views of 30x60"), ((6, 7), "auto", "6x7 views of 50x60")],
)
def test_a_mosaic_read_with_other_numbers_than_its_own_is_noted(pixels, arrangement, read_as):
    (note,) = read(MOSAIC, pixels=pixels, arrangement=arrangement, order="given").notes
    assert note == (
        f"pixels: read as a mosaic of {read_as} pixels, but the picture repeats every 60x60 pixels, as a "
        "mosaic of 5x7 views (rows x columns) does; give pixels 5x7"
    )


@pytest.mark.parametrize("layout", [{"lenses": (5, 7)}, {"pixels": (60, 60)}])
def test_views_taken_for_elemental_images_are_noted(layout):
    (note,) = read(MOSAIC, order="given", **layout).notes
    assert note == (
        "arrangement: read as 5x7 elemental images of 60x60 pixels, which may be views: if they are, give arrangement "
        "mosaic and pixels 5x7"
    )
    assert np.array_equal(read(MOSAIC, pixels=(5, 7), arrangement="mosaic").views, VIEWS)


def test_elemental_images_taken_for_a_mosaic_are_noted(vase):
    (note,) = read(vase, pixels=(9, 9), arrangement="mosaic", order="given").notes
    assert note == (
        "arrangement: read as a mosaic of 9x9 views, but the picture repeats about every 8x9 pixels, as elemental "
        "images of 9x9 do; arrangement eia reads it that way"
    )


def test_a_note_on_a_mosaic_has_the_name_that_a_quilt_needs():
    """The name that is advised is one that the quilt's reader understands."""
    wide = np.repeat(MOSAIC, 2, axis=1)  # views twice as wide as high
    (note,) = (note for note in read(wide, pixels=(5, 7), order="given").notes if note.startswith("arrangement"))
    advised = re.search(r"name it (\S+),", note)[1]
    assert parse_name(advised) == QuiltName(7, 5, 2.0)


@pytest.mark.parametrize(
    ("view", "grid", "advice"),
    [
        ((560, 420), (6, 8), "NAME_qs8x6a0.75.png"),
        ((720, 960), (6, 8), "NAME_qs8x6a1.77778.png"),  # of a 16-landscape, whose pixels aren't square
        ((720, 961), (6, 8), "NAME_qs8x6a1.33472.png"),
        ((15, 15), (50, 50), ""),  # elemental images of 50x50 lenses
        ((3, 303), (2, 2), ""),  # wider than a quilt's views may be
        ((2000, 2000), (1001, 2), ""),  # more than a quilt may have
    ],
)
def test_only_what_may_be_a_quilt_gets_a_name(view, grid, advice):
    found = advise_quilt(view, grid)
    assert found == (f"if it is a quilt, name it {advice}, or put its NAME.png.json next to it" if advice else "")


def test_a_picture_of_the_size_of_a_devices_quilt_may_be_one_even_if_it_shows_no_views():
    """Large quilts with a plain background often don't."""
    plain = np.zeros((3360, 3360, 1), np.uint8)
    assert message(plain).startswith(
        "a.png: if it is a quilt, name it NAME_qs8x6a0.75.png, or put its NAME.png.json next to it; any other picture "
        "is read as an elemental image array; give the number of lenses"
    )
    for other in (message(plain, arrangement="eia"), message(plain[1:])):
        assert other.startswith("a.png: a picture is read as an elemental image array; give the number of lenses")


def test_the_text_of_a_png_counts_before_what_looks_like_eslf():
    views = make_views((14, 14), side=20, disparities=(0, 0), channels=3)
    views[[0, 0, -1, -1], [0, -1, 0, -1]] = 0
    field = read_png(LightField(views).eia(), write_text("eia", (14, 14, 20, 20)))
    assert np.array_equal(field.views, views)
    assert field.depth_sense == "lenses"
