"""Raw lenslet pictures as inputs: with frames, with a part of the grid given, and what is refused."""

import io
from dataclasses import replace

import numpy as np
import pytest

import ciir
from ciir.errors import InvalidOption, TooLarge, Unreadable
from ciir.renderer.levels import ROUNDED
from ciir.renderer.limits import Limits
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import find_main, read
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.lenslet import reader
from ciir.renderer.readers.lenslet.calibration import Calibration
from ciir.renderer.readers.lenslet.grid import Known, LensGrid
from ciir.renderer.writers.pictures import encode_png
from tests.support.inputs import CUBE, make_picture
from tests.support.lenslet.camera import make_camera, take_picture

KNOWN = Known(9.3, (4.2, 5.1), 0.5, "square")
CAMERA = make_camera("vase", LensGrid(KNOWN.pitch, KNOWN.offset, KNOWN.rotation, "square"), (150, 180), (200, 200, 200))
RAW, WHITE = take_picture(CAMERA, noise=0), take_picture(CAMERA, white=True, noise=0)
DARK = np.full_like(RAW, 4)


def make_bundle(**pictures):
    """A set of pictures, or the only one as a file."""
    files = {f"{name}.png": encode_png(picture) for name, picture in pictures.items()}
    return Bundle("a.zip" if len(files) > 1 else "raw.png", None if len(files) > 1 else next(iter(files)), files)


def test_views_of_the_middle_are_brightest_without_a_white_picture():
    light_field = read(make_bundle(raw=RAW), Layout(lens_grid=KNOWN))
    assert light_field.views.shape[:2] == (9, 9)
    assert light_field.views[4, 4].mean() > 1.5 * light_field.views[0, 0].mean()
    assert light_field.notes[0] == (
        "lens grid: square, pitch 9.300 pixels, first lens at 4.20,5.10 (y, x), rotation 0.500 degrees, as given"
    )
    assert "there was no white picture" in light_field.notes[1]


def test_arrays_are_read_as_files_are(tmp_path):
    for name, picture in (("raw", RAW), ("white", WHITE), ("dark", DARK)):
        (tmp_path / f"{name}.png").write_bytes(encode_png(picture))
    expected = ciir.open(tmp_path / "raw.png", lens_pitch=9.3, white=tmp_path / "white.png", dark=tmp_path / "dark.png")
    found = ciir.open(RAW, lens_pitch=9.3, white=WHITE, dark=DARK)
    np.testing.assert_array_equal(found.views, expected.views)
    assert "there was no white picture" not in str(found.notes)


def test_a_grid_of_whole_numbers_is_read_as_an_elemental_image_array():
    bundle = make_bundle(raw=make_picture(6 * 5, 9 * 5, 3))
    found = read(bundle, Layout(lens_grid=Known(5.0, (2.0, 2.0), 0.0, "square"), order="given"))
    expected = read(bundle, Layout(pixels=(5, 5), arrangement="eia", order="given"))
    assert found.views.shape[:4] == (5, 5, 6, 9)
    np.testing.assert_array_equal(found.views, expected.views)
    assert found.depth_sense == "lenses"


def test_frames_even_out_the_lenses():
    files = make_bundle(raw=RAW + DARK, white=WHITE + DARK, dark=DARK)
    light_field = read(files, Layout(lens_grid=KNOWN, pixels=(7, 7)))
    grey = light_field.views[:, :, 0, 0].astype(float)  # the background, in the corner of each view
    assert grey.min() > 0.9 * grey.max()
    assert len(light_field.notes) == 1


def test_an_optical_pickup_is_the_virtual_one_turned():
    files = make_bundle(raw=take_picture(CAMERA, optical=True, noise=0))
    optical = read(files, Layout(lens_grid=KNOWN, pickup="optical")).views
    virtual = read(make_bundle(raw=RAW), Layout(lens_grid=KNOWN)).views
    # One ray for each pixel: the turned picture samples other rays, by up to half a pixel.
    assert np.abs(optical.astype(int) - virtual).mean() < 2.5
    assert np.abs(optical[::-1, ::-1].astype(int) - virtual).mean() > 4


def test_a_grid_that_is_not_certain_is_noted():
    grid = LensGrid(9.3, (4.2, 5.1), 0.5)
    assert reader._describe_grid(Calibration(grid, "borders", 0.2, 0.03, 0.02)).endswith(
        "rotation 0.500 degrees; 20% of the lenses agree, within 0.03 pixels (median), which settles the pitch times "
        "all lenses to 0.02 pixels (standard error)"
    )
    assert reader._describe_grid(Calibration(grid, "borders", 0.2, 0.03)).endswith("within 0.03 pixels (median)")
    assert "a white picture would settle it" in reader._describe_grid(Calibration(grid, "borders", 0.2, 0.03, 0.06))
    assert "may be wrong: see --show-grid" in reader._describe_grid(Calibration(grid, "edges", 0.2, 0.03))


def test_the_grid_is_found_in_the_white_picture():
    files = make_bundle(raw=np.zeros_like(RAW), white=WHITE)
    found = read(files, Layout(lens_grid=Known()))
    assert float(found.notes[0].split("pitch ")[1].split()[0]) == pytest.approx(KNOWN.pitch, abs=0.003)


def test_a_white_picture_without_a_grid_is_refused_as_one():
    with pytest.raises(Unreadable, match=r"at least 8; give lens_pitch, lens_offset, lens_rotation and lens_grid$"):
        read(make_bundle(raw=RAW, white=np.full_like(RAW, 200)), Layout(lens_grid=Known()))


def test_a_hexagonal_grid_is_resampled_with_a_note():
    known = Known(9.3, (4.2, 5.1), 0.5, "hexagonal")
    notes = read(make_bundle(raw=RAW), Layout(lens_grid=known)).notes
    assert notes[-1] == "the hexagonal grid was resampled to 18x20 pixels of a square one"


def test_a_set_of_a_picture_and_frames_is_that_picture():
    assert find_main(make_bundle(raw=RAW, white=WHITE))[1] == "raw.png"
    with pytest.raises(InvalidOption, match=r"lens_pitch: a\.zip holds a picture with white or dark frames"):
        read(make_bundle(raw=RAW, white=WHITE), Layout(pixels=(3, 3)))


def test_files_beside_a_picture_are_no_frames():
    files = {"raw.png": encode_png(RAW), "white.png": encode_png(WHITE)}
    notes = read(Bundle("raw.png", "raw.png", files), Layout(lens_grid=KNOWN)).notes
    assert "there was no white picture" in notes[1]


@pytest.mark.parametrize(
    ("pitch", "shape", "noted"),
    [
        (14.37, "square", "lenses are 14.37 pixels apart, so views mix"),
        (15.0, "hexagonal", "lenses are 15.00 pixels apart in a hexagonal grid"),
        (15.0, "square", None),
    ],
)
def test_a_raw_picture_that_is_read_as_elemental_images_is_noted(pitch, shape, noted):
    grid = LensGrid(pitch, (7, 7), 0.0 if pitch == 15 else 0.8, shape)
    picture = take_picture(make_camera("vase", grid, (360, 390), (90, 120, 150)))
    notes = " ".join(read(make_bundle(raw=picture), Layout(pixels=(15, 15))).notes)
    assert noted in notes if noted else "lenses are" not in notes
    assert "lenses are" not in " ".join(read(make_bundle(raw=RAW), Layout(pixels=(5, 5), arrangement="eia")).notes)


def test_lenses_that_keep_most_of_their_light_at_the_border_are_noted_too():
    """What repeats in their picture is its content, after 12x12 pixels."""
    grid = LensGrid(14.37, (5.3, 8.8), 0.8, "square")
    picture = take_picture(make_camera("vase", grid, (361, 391)), edge=0.8)
    with pytest.raises(InvalidOption, match=r"; its lenses are 14\.\d\d pixels apart: give lens_pitch auto"):
        read(make_bundle(raw=picture), Layout(pixels=(14, 14)))


@pytest.mark.parametrize(
    ("scene", "words"), [("vase", r"lenses or pixels \(by its period 9x9 or .*"), (None, "lenses or pixels")]
)
def test_an_elemental_image_array_without_a_grid_of_lenses_is_called_one(scene, words):
    picture = np.zeros((90, 90, 3), np.uint8)
    if scene:
        picture = ciir.render(f"scene:{scene}", lenses=(100, 100), pixels=(9, 9), backend="raytrace").eia()
    with pytest.raises(
        Unreadable,
        match="shows no lens grid .*; if it is an elemental image array, leave lens_pitch out and give " + words + "$",
    ):
        read(make_bundle(raw=picture), Layout(lens_grid=Known()))


@pytest.mark.parametrize(
    ("files", "layout", "message"),
    [
        ({"raw": RAW}, {"lenses": (3, 3)}, "lenses: this is for elemental image arrays, and lens_pitch says"),
        ({"raw": RAW}, {"crop": (1, 1, 1, 1)}, "crop: this is for elemental image arrays"),
        (
            {"raw": RAW},
            {"pixels": (11, 11)},
            "pixels: 11x11 are more than lenses of 9.30 pixels have; give at most 10x10",
        ),
        ({"raw": RAW, "white": WHITE[:50]}, {}, "white: the white picture has 50x180 .*, the raw one 150x180"),
        ({"a": RAW, "b": RAW}, {}, "lens_pitch: this is for one raw lenslet picture, and a.zip is not one"),
    ],
)
def test_what_does_not_fit_is_refused(files, layout, message):
    with pytest.raises(InvalidOption, match=message):
        read(make_bundle(**files), Layout(lens_grid=KNOWN, **layout))


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_an_array_is_read_as_the_same_picture_in_png(dtype):
    file = io.BytesIO()
    np.save(file, RAW if dtype == np.uint8 else (RAW / 255).astype(dtype))
    picture, white, dark = (
        shown if dtype == np.uint8 else shown.astype(np.uint16) * 257 for shown in (RAW, WHITE, DARK)
    )
    for frames in ({}, {"white": WHITE}, {"white": white, "dark": dark}):
        files = {f"{name}.png": encode_png(frame) for name, frame in frames.items()}
        found = read(
            Bundle("a", None if files else "raw.npy", {"raw.npy": file.getvalue()} | files), Layout(lens_grid=KNOWN)
        )
        expected = read(make_bundle(raw=picture, **frames), Layout(lens_grid=KNOWN))
        assert np.array_equal(found.views, expected.views)
        assert found.notes == expected.notes + ((ROUNDED,) if dtype != np.uint8 else ())
    with pytest.raises(InvalidOption, match="holds a picture with white or dark frames"):
        read(Bundle("a", None, {"raw.npy": file.getvalue(), "white.png": encode_png(WHITE)}), Layout(pixels=(3, 3)))


def test_a_white_picture_may_have_other_bits():
    for picture, white in ((RAW.astype(np.uint16) * 257, WHITE), (RAW, WHITE.astype(np.uint16) * 257)):
        same = WHITE.astype(picture.dtype) * (257 if picture.dtype == np.uint16 else 1)
        found, expected = (read(make_bundle(raw=picture, white=one), Layout(lens_grid=KNOWN)) for one in (white, same))
        assert np.abs(found.views.astype(int) - expected.views).max() <= 1
        with pytest.raises(InvalidOption, match=r"white: the white picture has .* bit, the raw one .* bit"):
            read(make_bundle(raw=picture, white=white, dark=picture // 50), Layout(lens_grid=KNOWN))


def test_grey_frames_count_for_all_channels():
    grey, dark = WHITE[..., 1:2], (np.arange(RAW.shape[1], dtype=np.uint8) % 7)[None, :, None].repeat(len(RAW), axis=0)
    opaque = np.concatenate([RAW, np.full_like(RAW[..., :1], 255)], axis=2)
    for picture in (RAW, opaque):
        for frames in ({"white": grey}, {"dark": dark}, {"white": grey, "dark": dark}):
            repeated = {name: frame.repeat(picture.shape[2], axis=2) for name, frame in frames.items()}
            found, expected = (
                read(make_bundle(raw=picture, **given), Layout(lens_grid=KNOWN)) for given in (frames, repeated)
            )
            assert np.array_equal(found.views, expected.views)
            assert found.notes == expected.notes
    coloured = read(make_bundle(raw=RAW, white=grey, dark=DARK), Layout(lens_grid=KNOWN))
    assert not np.array_equal(coloured.views, read(make_bundle(raw=RAW), Layout(lens_grid=KNOWN)).views)
    with pytest.raises(InvalidOption, match=r"white: the white picture has 150x180 pixels of 3 channels, .* of 1 chan"):
        read(make_bundle(raw=RAW[..., :1], white=WHITE), Layout(lens_grid=KNOWN))


def test_a_mesh_is_no_raw_picture():
    with pytest.raises(InvalidOption, match=r"lens_pitch: this is for one raw lenslet picture, and a\.off is not one"):
        read(Bundle("a.off", "a.off", {"a.off": CUBE}), Layout(lens_grid=KNOWN))


def test_views_over_the_limit_are_refused_before_they_are_made():
    files = make_bundle(raw=RAW)
    with pytest.raises(TooLarge, match=r"its views take up to .* bytes; at most 1,000 are read"):
        read(Bundle("raw.png", "raw.png", files.files, Limits(set_bytes=1000)), Layout(lens_grid=KNOWN))


def draw(bundle, known):
    kept = []
    read(replace(bundle, keep_grid=kept.append), Layout(lens_grid=known))
    (drawn,) = kept
    return drawn


def test_columns_of_lenses_are_rows_of_the_transposed_picture():
    known = Known(9.3, (4.2, 5.1), 0.5, "hexagonal")
    rows = read(make_bundle(raw=RAW), Layout(lens_grid=known, pixels=(5, 7)))
    bundle, columns = make_bundle(raw=RAW.swapaxes(0, 1)), Known(9.3, (5.1, 4.2), -0.5, "hexagonal-columns")
    found = read(bundle, Layout(lens_grid=columns, pixels=(7, 5)))
    assert np.array_equal(found.views, rows.views.transpose(1, 0, 3, 2, 4))
    assert "hexagonal-columns, pitch 9.300 pixels, first lens at 5.10,4.20 (y, x), rotation -0.500" in found.notes[0]
    assert np.array_equal(draw(bundle, columns), draw(make_bundle(raw=RAW), known).swapaxes(0, 1))


def test_a_picture_alone_in_a_set_is_the_raw_one():
    bundle = Bundle("a.zip", None, {"raw.png": encode_png(RAW), "read.me": b"by us"})
    light_field = read(bundle, Layout(lens_grid=KNOWN))
    assert np.array_equal(light_field.views, read(make_bundle(raw=RAW), Layout(lens_grid=KNOWN)).views)
    assert light_field.lens_pitch == KNOWN.pitch


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_the_grid_is_drawn_over_the_picture(dtype):
    picture = make_picture(60, 80, 1, dtype)
    known = Known(20.0, (9.9, 9.9), 0.0, "square")
    drawn = draw(make_bundle(raw=picture), known)
    assert drawn.shape == (60, 80, 3)
    assert tuple(drawn[10, 10]) == tuple(drawn[30, 70]) == (0, 255, 255)
    grey = picture[5, 5, 0] >> (8 if dtype == np.uint16 else 0)
    assert tuple(drawn[5, 5]) == (grey,) * 3
    assert drawn[19, 5, 0] > drawn[19, 5, 2]  # between the first two rows of lenses


def test_another_pitch_than_the_one_given_is_noted():
    """Half a pitch fits all lenses, too, and one that is given with all else isn't looked for."""
    camera = make_camera("globe", LensGrid(14.37, (5.3, 8.8), 0.8), (640, 700), (90, 120, 150))
    picture = take_picture(camera)
    for known in (Known(7.185), Known(13.0, (5.3, 8.8), 0.8, "square")):
        (note,) = [
            note
            for note in read(make_bundle(raw=picture), Layout(lens_grid=known, pixels=(3, 3))).notes
            if note.startswith("lens_pitch: ")
        ]
        assert note == (
            f"lens_pitch: {known.pitch:g} was given, but lenses 14.37 pixels apart are seen in the picture; lens_pitch "
            "auto finds them"
        )
    right = read(make_bundle(raw=picture), Layout(lens_grid=Known(14.37), pixels=(3, 3)))
    assert not [note for note in right.notes if note.startswith("lens_pitch: ")]


@pytest.mark.parametrize(
    ("shape", "is_turned", "is_hidden"),
    [("square", False, False), ("square", False, True), ("hexagonal", False, False), ("hexagonal", True, False)],
)
def test_another_offset_than_the_one_given_is_noted(shape, is_turned, is_hidden):
    grid = LensGrid(14.37, (5.3, 8.8), 0.8, shape)
    picture = take_picture(make_camera("globe", grid, (640, 700), (90, 120, 150)))
    for away in (0, 3, 5):  # pixels: a quarter of the pitch is 3.6
        known = Known(grid.pitch, (5.3 + away, 8.8), 0.8, shape)
        if is_turned:
            known = Known(grid.pitch, (8.8, 5.3 + away), -0.8, "hexagonal-columns")
        elif is_hidden:
            known = Known(offset=known.offset)
        bundle = make_bundle(raw=picture.swapaxes(0, 1) if is_turned else picture)
        notes = read(bundle, Layout(lens_grid=known, pixels=(3, 3))).notes
        found = [note for note in notes if note.startswith("lens_offset: ")]
        assert len(found) == (away > 3.6)
    given, seen = (part.split(" (y, x)")[0].split(";")[0] for part in found[0].split(" at ")[1:])
    away_y, away_x = np.subtract(*([float(number) for number in place.split(",")] for place in (given, seen)))
    assert (away_y, away_x) == pytest.approx((0, 5) if is_turned else (5, 0), abs=0.1)
    assert f"{'8.8,10.3' if is_turned else '10.3,8.8'} puts a lens in the middle of the picture at " in found[0]
    assert found[0].endswith("; leave lens_offset out to find it")
