"""Elemental image arrays and mosaics of the same views differ in their periods."""

import numpy as np
import pytest

import ciir
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.eia.period import Periods
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode
from tests.support.light_fields import make_views
from tests.support.paths import SHARED

CAPTURED = SHARED / "data" / "lightfields"


def make_mosaic(views):
    rows, cols, height, width, channels = views.shape
    return views.swapaxes(1, 2).reshape(rows * height, cols * width, channels)


@pytest.mark.parametrize(
    ("grid", "side"), [((3, 3), 40), ((5, 7), 60), ((9, 9), 50), ((15, 15), 30), ((1, 9), 96), ((9, 1), 96)]
)
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_drawn_views(grid, side, channels):
    views = make_views(grid, side=side, disparities=(-1, 1), channels=channels, noise=4.0)
    assert Periods(LightField(views).eia()).find_arrangement(grid) == "eia"
    assert Periods(make_mosaic(views)).find_arrangement(grid) == "mosaic"


@pytest.mark.parametrize("scene", ["vase", "globe", "hamburger"])
@pytest.mark.parametrize(("lenses", "pixels"), [((50, 50), (9, 9)), ((40, 60), (5, 7)), ((40, 40), (20, 20))])
def test_rendered_views(scene, lenses, pixels):
    light_field = ciir.render(f"scene:{scene}", lenses=lenses, pixels=pixels, backend="raytrace")
    eia = Periods(light_field.eia())
    assert eia.find_arrangement(pixels) == "eia"
    assert not eia.repeats_within(pixels)
    assert eia.repeats_within((2 * pixels[0], 2 * pixels[1])) is (eia.find() is not None)
    assert not eia.is_mosaic(pixels)
    assert Periods(make_mosaic(light_field.views)).find_arrangement(pixels) == "mosaic"


@pytest.mark.parametrize(
    ("scene", "lenses", "pixels"),
    [
        ("vase", (60, 80), (5, 7)),  # 60x112 of 5x5 would divide it too
        ("vase", (64, 64), (12, 9)),
        ("vase", (80, 60), (7, 5)),
        ("globe", (36, 64), (7, 7)),  # 42x64 of 6x7 would
        ("globe", (50, 30), (16, 16)),
        ("vase", (40, 60), (9, 9)),
    ],
)
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_elemental_images_that_divide_a_picture_in_several_ways(scene, lenses, pixels, suffix):
    eia = ciir.render(f"scene:{scene}", lenses=lenses, pixels=pixels, backend="raytrace").eia()
    assert Periods(decode(encode(eia, suffix), name="a")).rank_sizes()[0] == pixels


@pytest.mark.parametrize("scene", ["vase", "globe", "hamburger"])
def test_views_of_a_mosaic_that_squares_would_divide_too(scene):
    views = ciir.render(f"scene:{scene}", lenses=(60, 80), pixels=(8, 6), backend="raytrace").views
    periods = Periods(make_mosaic(views))
    assert periods.rank_sizes()[0] == (60, 80)  # not 160x160
    assert periods.is_mosaic((60, 80))


@pytest.mark.skipif(not CAPTURED.is_dir(), reason="needs the captured light fields")
@pytest.mark.parametrize(
    ("name", "expected"),
    # The views of saii-5x5 are too far apart for a mosaic's period to show.
    [("lytro-2067", "mosaic"), ("saii-5x5", None), ("eia-200x200x15.jpg", "mosaic")],
)
def test_captured_views(name, expected):
    light_field = ciir.open(CAPTURED / name, **({"lenses": (200, 200)} if name.endswith("jpg") else {}))
    grid = light_field.shape[:2]
    eia = Periods(light_field.eia())
    assert eia.find_arrangement(grid) == "eia"
    assert eia.find() == grid
    assert not eia.repeats_within(grid)
    assert eia.repeats_within((2 * grid[0], 2 * grid[1]))
    assert Periods(make_mosaic(light_field.views)).find_arrangement(grid) == expected


@pytest.mark.parametrize("shape", [(200, 300, 3), (200, 300, 1), (2, 400, 3), (20, 20, 3), (1, 1, 1)])
def test_what_shows_no_period_is_neither(shape):
    noise = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    for picture in (np.zeros(shape, np.uint8), noise):
        periods = Periods(picture)
        assert periods.find() is None
        assert periods.find_arrangement((1, 1)) == "eia"
        if min(shape[:2]) >= 64:
            assert periods.find_arrangement((10, 10)) is None
