import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from ciir.errors import InvalidImage
from ciir.models import processor
from ciir.models.cards import Sizes
from ciir.models.catalogue import SHIPPED, load_upscaler
from ciir.models.single.network import SingleImageNetwork

TILE_PIXELS = "ciir.models.single.network.TILE_PIXELS"


def make_noise(*shape: int) -> np.ndarray:
    return np.random.default_rng(11).random(shape, dtype=np.float32)


@pytest.fixture(scope="module")
def paper():
    return load_upscaler("paper")


@pytest.mark.parametrize("shape", [(1, 3, 1, 1), (2, 3, 1, 7), (1, 3, 13, 2), (3, 3, 25, 25), (0, 3, 5, 6)])
def test_any_size(paper, shape):
    large = paper(make_noise(*shape))
    assert large.shape == (shape[0], 3, 2 * shape[2], 2 * shape[3])
    assert large.dtype == np.float32
    assert ((large >= 0) & (large <= 1)).all()


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (3, 3), (4, 60), (7, 5)])
def test_small_flat_pictures_are_as_flat_as_large_ones(paper, size):
    for grey in (0.25, 0.5, 1.0):
        large = paper(np.full((1, 3, 24, 24), grey, np.float32))
        small = paper(np.full((1, 3, *size), grey, np.float32))
        assert np.abs(small - grey).max() <= np.abs(large - grey).max() + 1 / 255


def test_a_batch_equals_its_pictures_one_by_one(paper):
    images = make_noise(9, 3, 31, 40)
    np.testing.assert_allclose(paper(images), np.concatenate([paper(image[None]) for image in images]), atol=1e-5)


@pytest.mark.parametrize("size", [(40, 57), (97, 33), (34, 34), (20, 120)])
def test_tiled_equals_whole(paper, size, monkeypatch):
    images = make_noise(2, 3, *size)
    whole = paper(images)
    monkeypatch.setattr(TILE_PIXELS, 34 * 34)  # tiles of 4 pixels within a halo of 15
    np.testing.assert_allclose(paper(images), whole, atol=1e-5)


@pytest.mark.skipif(processor.int8_unsupported_reason() != "", reason=processor.int8_unsupported_reason())
def test_int8_tiles_in_parallel_equal_those_on_one_core(monkeypatch):
    monkeypatch.setattr(TILE_PIXELS, 48 * 48)
    one, three = (SingleImageNetwork(SHIPPED / "fast-int8.json", threads=threads) for threads in (1, 3))
    used, images = [], make_noise(2, 3, 97, 90)
    monkeypatch.setattr(three, "_run", lambda *given: used.append(given[1]) or SingleImageNetwork._run(three, *given))
    assert np.array_equal(three(images), one(images))
    assert len(used) >= 6
    assert set(used) == {1}


def test_a_halo_that_is_too_small_shows(paper, monkeypatch):
    images = make_noise(1, 3, 60, 60)
    whole = paper(images)
    monkeypatch.setattr(TILE_PIXELS, 34 * 34)
    monkeypatch.setattr(paper, "radius", 5)
    assert np.abs(paper(images) - whole).max() > 1e-3


def test_not_a_number_is_refused(paper):
    images = make_noise(2, 3, 4, 4)
    images[1, 0, 2, 3] = np.nan
    with pytest.raises(InvalidImage, match=r"\(1, 0, 2, 3\)"):
        paper(images)


def test_calls_from_many_threads(paper):
    pictures = [make_noise(1, 3, 20 + i, 30 - i) for i in range(8)]
    expected = [paper(picture) for picture in pictures]
    with ThreadPoolExecutor(8) as pool:
        outputs = list(pool.map(paper, pictures * 4))
    for i, output in enumerate(outputs):
        np.testing.assert_allclose(output, expected[i % 8], atol=1e-6)


@pytest.mark.parametrize("sizes", [Sizes(16, 6), Sizes(1, 4, square=True), Sizes(40)])
def test_the_network_gets_only_sizes_that_it_takes(paper, sizes, monkeypatch):
    given = []

    def run(images, cores):
        given.append(images.shape[2:])
        return SingleImageNetwork._run(paper, images, cores)

    monkeypatch.setattr(TILE_PIXELS, 48 * 48)
    monkeypatch.setattr(paper, "card", dataclasses.replace(paper.card, sizes=sizes))
    monkeypatch.setattr(paper, "_run", run)
    for shape in [(1, 3, 3, 5), (2, 3, 20, 33), (1, 3, 61, 130)]:
        assert paper(make_noise(*shape)).shape == (shape[0], 3, 2 * shape[2], 2 * shape[3])
    assert given
    assert all(size == sizes.round_up(*size) for size in given)
