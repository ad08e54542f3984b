import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.models import tiles

sizes = st.integers(1, 70)


@settings(max_examples=150)
@given(height=sizes, width=sizes, radius=st.integers(0, 4), side=st.integers(9, 30))
def test_tiles_cover_once_and_have_a_halo(height, width, radius, side):
    covered = np.zeros((height, width), int)
    shapes = set()
    for tile in tiles.split_picture(height, width, radius=radius, tile_pixels=side * side):
        covered[tile.kept] += 1
        shapes.add(tuple(side.stop - side.start for side in tile.region))
        for region, kept, length in zip(tile.region, tile.kept, (height, width), strict=True):
            assert 0 <= region.start <= kept.start < kept.stop <= region.stop <= length
            assert region.start == 0 or kept.start - region.start >= radius
            assert region.stop == length or region.stop - kept.stop >= radius
    assert (covered == 1).all()
    (shape,) = shapes
    assert shape[0] * shape[1] <= side * side


@settings(max_examples=150)
@given(height=sizes, width=sizes, radius=st.integers(0, 4), step=st.integers(1, 4))
def test_tiles_keep_to_multiples(height, width, radius, step):
    height, width = height * step, width * step
    covered = np.zeros((height, width), int)
    for tile in tiles.split_picture(height, width, radius=radius, tile_pixels=30 * 30, multiple=step):
        covered[tile.kept] += 1
        for region, kept, length in zip(tile.region, tile.kept, (height, width), strict=True):
            assert {edge % step for edge in (region.start, region.stop, kept.start, kept.stop)} == {0}
            assert region.start == 0 or kept.start - region.start >= radius
            assert region.stop == length or region.stop - kept.stop >= radius
    assert (covered == 1).all()


def test_padding_repeats_the_edge_and_returns_where_the_picture_is():
    images = np.arange(6, dtype=np.float32).reshape(1, 1, 2, 3)
    padded, (rows, cols) = tiles.pad_pictures(images, 5, 4, scale=2)
    assert padded.shape == (1, 1, 5, 4)
    assert (rows, cols) == (slice(2, 6), slice(0, 6))
    assert np.array_equal(padded[:, :, 1:3, :3], images)
    assert np.array_equal(padded[0, 0, :, 3], [2, 2, 5, 5, 5])
    same, _ = tiles.pad_pictures(images, 2, 3, scale=2)
    assert same is images


def test_tiles_that_are_all_halo_are_refused():
    with pytest.raises(ValueError, match="halo of 5"):
        list(tiles.split_picture(100, 100, radius=5, tile_pixels=100))


def blur(images: np.ndarray, reach: int) -> np.ndarray:
    """Sums of the `(2*reach + 1)**2` neighbours, zeros outside, then each pixel doubled: like a network."""
    height, width = images.shape[2:]
    padded = np.pad(images, ((0, 0), (0, 0), (reach, reach), (reach, reach)))
    side = range(2 * reach + 1)
    total = sum(padded[:, :, y : y + height, x : x + width] for y in side for x in side)
    return total.repeat(2, axis=2).repeat(2, axis=3)


@pytest.mark.parametrize(
    "shape", [(1, 3, 40, 53), (3, 3, 9, 64), (2, 1, 61, 7), (7, 3, 5, 5), (2, 3, 1, 1), (0, 3, 4, 4)]
)
@pytest.mark.parametrize("radius", [2, 3])
@pytest.mark.parametrize("at_once", [False, True])
def test_tiled_equals_whole(shape, radius, at_once):
    images = np.random.default_rng(1).integers(0, 9, shape).astype(np.float32)
    got = tiles.run_in_tiles(
        lambda x, _: blur(x, 2),
        images,
        scale=2,
        radius=radius,
        tile_pixels=144,
        batch_pixels=60,
        cores=2,
        at_once=at_once,
    )
    assert np.array_equal(got, blur(images, 2))


def test_a_halo_one_pixel_too_small_shows():
    images = np.ones((1, 3, 40, 53), np.float32)
    got = tiles.run_in_tiles(lambda x, _: blur(x, 2), images, scale=2, radius=1, tile_pixels=144, batch_pixels=60)
    assert not np.array_equal(got, blur(images, 2))


def test_batches_and_tiles_stay_within_their_limits():
    shapes = []

    def run(images: np.ndarray, _: int) -> np.ndarray:
        shapes.append(images.shape)
        return images

    tiles.run_in_tiles(run, np.zeros((10, 3, 5, 5), np.float32), scale=1, radius=1, tile_pixels=400, batch_pixels=100)
    assert shapes == [(4, 3, 5, 5), (4, 3, 5, 5), (2, 3, 5, 5)]
    shapes.clear()
    tiles.run_in_tiles(run, np.zeros((2, 3, 50, 50), np.float32), scale=1, radius=1, tile_pixels=400, batch_pixels=100)
    assert {shape[0] for shape in shapes} == {1}
    assert max(shape[2] * shape[3] for shape in shapes) <= 400


@pytest.mark.parametrize(
    ("sides", "at_once", "used"), [((20, 20), True, {4}), ((40, 40), True, {1}), ((40, 40), False, {4})]
)
def test_many_tiles_have_a_core_each(sides, at_once, used):
    found = set()

    def run(images: np.ndarray, cores: int) -> np.ndarray:
        found.add(cores)
        return images

    images = np.zeros((1, 3, *sides), np.float32)
    tiles.run_in_tiles(run, images, scale=1, radius=1, tile_pixels=144, batch_pixels=1, cores=4, at_once=at_once)
    assert found == used


def test_a_tile_of_a_tile_keeps_no_more_than_it():
    outer = tiles.Tile(np.s_[10:40, 20:50], np.s_[14:36, 24:50])
    inner = tiles.Tile(np.s_[0:12, 9:30], np.s_[0:8, 13:30]).clip_to(outer)
    assert inner == tiles.Tile(np.s_[10:22, 29:50], np.s_[14:18, 33:50])
    assert inner.region_in(outer.region) == np.s_[0:12, 9:30]


def test_a_tile_of_a_tile_can_keep_nothing():
    outer = tiles.Tile(np.s_[10:40, 0:30], np.s_[14:36, 0:30])
    rows, cols = tiles.Tile(np.s_[0:6, 0:30], np.s_[0:3, 0:30]).clip_to(outer).kept
    assert rows.start == rows.stop
    assert cols == np.s_[0:30]
