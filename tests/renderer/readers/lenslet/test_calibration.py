"""Calibration of pictures that are cast ray by ray, from the picture alone."""

from functools import cache

import numpy as np
import pytest
from PIL import Image

from ciir.errors import Unreadable
from ciir.renderer.readers.lenslet import calibration
from ciir.renderer.readers.lenslet.calibration import Calibration, calibrate
from ciir.renderer.readers.lenslet.grid import Known, LensGrid
from tests.support.lenslet.camera import dim, make_camera, take_picture
from tests.support.lenslet.trials import measure_errors, measure_loss
from tests.support.paths import SHARED

SIZE = (640, 700)
"""Pixels: 44x48 lenses."""


@cache
def take(shape, scene="globe", background=(90, 120, 150)):
    """A camera with a known grid, and its picture with vignetting and noise of 2 levels."""
    camera = make_camera(scene, LensGrid(14.37, (5.3, 8.8), 0.8, shape), SIZE, background)
    return camera, take_picture(camera)


@pytest.mark.parametrize("shape", ["square", "hexagonal"])
@pytest.mark.parametrize("scene", ["globe", "hamburger"])
def test_a_raw_picture_is_calibrated_from_itself(scene, shape):
    camera, picture = take(shape, scene)
    found = calibrate(picture).grid
    assert found.shape == shape
    over_all, offset = measure_errors(found, camera.grid, SIZE)
    assert over_all <= 0.05
    assert offset <= 0.1
    assert np.allclose(found.offset, camera.grid.offset, atol=0.1)  # at the corner
    assert found.rotation == pytest.approx(0.8, abs=0.005)  # 0.06 pixels over the picture


@pytest.mark.parametrize("shape", ["square", "hexagonal"])
def test_its_views_are_as_good_as_those_of_known_numbers(shape):
    camera, picture = take(shape)
    assert measure_loss(camera, picture, calibrate(picture).grid) <= 0.5


@pytest.mark.parametrize("shape", ["square", "hexagonal"])
def test_a_white_picture_is_calibrated(shape):
    camera, _ = take(shape)
    over_all, offset = measure_errors(calibrate(take_picture(camera, white=True)).grid, camera.grid, SIZE)
    assert over_all <= 0.01
    assert offset <= 0.01


@pytest.mark.parametrize(
    ("pitch", "shape"), [(9.5, "square"), (7.25, "square"), (10.0, "hexagonal"), (13.0, "hexagonal")]
)
def test_a_white_picture_without_noise_is_calibrated(pitch, shape):
    """Lenses look the same again after a few of them, whose centres lie at whole pixels."""
    grid = LensGrid(pitch, (5.3, 8.8), 0.0, shape)
    points = np.stack(np.indices((240, 250)), axis=-1)
    light = dim(grid, points - grid.find_centers(*grid.find_nearest(points)))
    found = calibrate(np.rint(60_000 * light[..., np.newaxis]).astype(np.uint16)).grid
    assert (found.pitch, found.shape) == (pytest.approx(pitch, abs=0.01), shape)


def test_a_white_picture_is_no_remedy_for_a_white_picture(monkeypatch):
    with pytest.raises(
        Unreadable, match=r"and each side must have at least 8; give lens_pitch, lens_offset, lens_rotation"
    ):
        calibrate(np.full((90, 90, 1), 200, np.uint8), is_white=True)
    monkeypatch.setattr(calibration, "_DISTINCT", 0)
    with pytest.raises(Unreadable, match=r"fit nearly as well; give lens_grid, or a white picture$"):
        calibrate(take("square")[1])
    with pytest.raises(Unreadable, match=r"fit nearly as well; give lens_grid$"):
        calibrate(take("square")[1], is_white=True)


def test_an_object_before_black_is_calibrated():
    """Its outline drifts through the elemental images with a period of its own."""
    size = 1437, 1437  # 100 lenses, of which 60 are lit
    camera = make_camera("globe", LensGrid(14.37, (5.3, 8.8), 0.8), size)
    found = calibrate(take_picture(camera))
    over_all, offset = measure_errors(found.grid, camera.grid, size)
    assert over_all <= 0.05
    assert offset <= 0.1
    assert found.uncertainty <= 0.05


def test_what_few_lenses_do_not_settle_is_in_the_uncertainty():
    """A textured globe before black, whose lenses keep 60 % of their light at the border."""
    camera = make_camera("globe", LensGrid(10.8, (5.3, 8.8), -1.3), (518, 578))
    found = calibrate(take_picture(camera, edge=0.6))
    over_all, _ = measure_errors(found.grid, camera.grid, camera.size)
    assert 0.05 < found.uncertainty < 1
    assert over_all < 2.5 * found.uncertainty


def test_what_is_known_is_kept():
    _, picture = take("square")
    found = calibrate(picture, Known(pitch=14.372, rotation=0.79, shape="square")).grid
    assert (found.pitch, found.rotation) == (14.372, 0.79)
    known = Known(14.3, (3.0, 4.0), 0.5, "hexagonal")
    assert calibrate(picture, known).grid == LensGrid(14.3, (3.0, 4.0), 0.5, "hexagonal")
    assert calibrate(picture, Known(offset=(5.3, 8.8))).grid.pitch == pytest.approx(14.37, abs=0.001)


def test_an_offset_outside_the_picture_is_that_of_a_lens_too():
    found = calibrate(take("square")[1], Known(offset=(5.3 - 14.37 * 20 * np.cos(np.deg2rad(0.8)), 12.81)))
    assert found.grid.pitch == pytest.approx(14.37, abs=0.001)


def test_a_wrong_pitch_is_refused():
    text = r"^picture: shows no lens grid of 15 pixels' pitch, but one of 14\.37; give lens_pitch 14\.37, or auto$"
    with pytest.raises(Unreadable, match=text):
        calibrate(take("square")[1], Known(pitch=15))
    noise = np.random.default_rng(0).integers(0, 255, (400, 500, 3), np.uint8)
    with pytest.raises(Unreadable, match=r"shows no lens grid of 15 pixels' pitch by itself: lenses must darken"):
        calibrate(noise, Known(pitch=15))


@pytest.mark.parametrize("shape", ["hexagonal", "hexagonal-columns"])
def test_a_wrong_shape_is_refused_with_the_one_that_the_picture_shows(shape):
    text = rf"^picture: shows no {shape} lens grid, but a square one of 14\.37; give lens_grid square, or leave it out$"
    with pytest.raises(Unreadable, match=text):
        calibrate(take("square")[1], Known(shape=shape))


@pytest.mark.parametrize("shape", ["hexagonal", "hexagonal-columns"])
def test_rows_that_are_called_columns_are_refused_and_columns_that_are_called_rows(shape):
    picture = take("hexagonal")[1]
    shown = "hexagonal-columns" if shape == "hexagonal" else "hexagonal"
    with pytest.raises(Unreadable, match=f"^picture: shows no {shape} lens grid, but a {shown} one of 14.37; give"):
        calibrate(picture.swapaxes(0, 1) if shape == "hexagonal" else picture, Known(shape=shape))


def test_lenses_that_lie_neither_in_rows_nor_in_columns_are_refused():
    """They were transposed again and again, to Python's limit of calls."""
    picture = np.resize(np.uint8(200) * (np.arange(286) < 71), (80, 80, 1))
    with pytest.raises(Unreadable, match=r"shows no lens grid of 7\.5 pixels' pitch by itself"):
        calibrate(picture, Known(7.5))


@pytest.mark.parametrize("rotation", [12, -14])
def test_a_large_rotation_is_found(rotation):
    """Not the finer hexagonal grid, 19.1 degrees from it, that has all its lenses too."""
    camera = make_camera("globe", LensGrid(14.37, (5.3, 8.8), rotation, "hexagonal"), SIZE, (90, 120, 150))
    found = calibrate(take_picture(camera)).grid
    assert (found.pitch, found.rotation) == pytest.approx((14.37, rotation), abs=0.005)


def test_hexagonal_lenses_in_columns_are_those_of_the_transposed_picture():
    camera, picture = take("hexagonal")
    found = calibrate(picture.swapaxes(0, 1))
    assert found.in_columns
    assert found.grid == calibrate(picture).grid
    asked = Known(14.37, (8.8, 5.3), -0.8, "hexagonal-columns")
    assert calibrate(picture.swapaxes(0, 1), asked) == Calibration(camera.grid, in_columns=True)


def test_a_picture_without_lenses_is_refused():
    speck = np.zeros((300, 300, 1), np.uint8)
    speck[140:150, 140:150] = 255
    noise = np.random.default_rng(0).integers(0, 255, (400, 500, 3), np.uint8)
    for picture in (noise, np.zeros_like(noise), np.full((1, 1, 3), 9, np.uint8), speck):
        with pytest.raises(Unreadable, match=r"a\.png: shows no lens grid.*give a white picture, or lens_pitch"):
            calibrate(picture, name="a.png")


def test_lenses_are_brightest_in_their_middle():
    """A picture alone can't tell the negative from lenses half a pitch away."""
    camera, _ = take("square")
    found = calibrate(250 - take_picture(camera, white=True)).grid
    i, j = camera.grid.find_nearest(np.array(found.offset))
    moved = (found.offset - camera.grid.find_centers(i, j)) @ camera.grid.axes.T
    assert np.allclose(np.abs(moved), 14.37 / 2, atol=0.1)


def test_a_real_elemental_image_array_is_calibrated():
    path = SHARED / "data/lightfields/eia-200x200x15.jpg"
    if not path.exists():
        pytest.skip("the shared test data is absent")
    with Image.open(path) as image:
        picture = np.array(image.crop((600, 600, 2100, 2100)))
    found = calibrate(picture)
    assert found.cue == "edges"
    assert found.grid.shape == "square"
    assert found.grid.pitch * 100 == pytest.approx(1500, abs=0.5)
    # Specks in the second pixel of each elemental image pull the centre, 7, towards them.
    assert np.allclose(np.mod(found.grid.offset, 15), 7, atol=1)
