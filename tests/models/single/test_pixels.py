import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hn

from ciir.errors import InvalidImage
from ciir.models.catalogue import load_upscaler
from ciir.models.single import pixels
from ciir.models.single.interpolation import Bicubic, Nearest
from ciir.models.single.pixels import upscale_pixels

DEPTHS = [np.uint8, np.uint16]


def make_noise(dtype, *shape: int) -> np.ndarray:
    return np.random.default_rng(3).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


@settings(max_examples=60)
@given(
    st.sampled_from(DEPTHS).flatmap(
        lambda dtype: hn.arrays(dtype, st.tuples(st.integers(0, 2), *[st.integers(1, 6)] * 2, st.integers(1, 4)))
    )
)
def test_nearest_gives_every_value_back(pictures):
    """Scaling to float, premultiplying and dividing lose nothing, save the colour of what is fully clear."""
    want = pictures.repeat(2, axis=1).repeat(2, axis=2)
    if pictures.shape[3] in (2, 4):
        want[want[..., -1] == 0] = 0
    got = upscale_pixels(Nearest(2), pictures)
    assert got.dtype == pictures.dtype
    assert np.array_equal(got, want)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", DEPTHS)
def test_fractions_of_levels_are_kept(dtype, channels):
    """With a background that is skipped, and with two equal pictures."""
    picture = make_noise(dtype, 1, 40, 30, channels)
    picture[:, 12:] = picture[:, 12:13, :1]
    pictures, network = np.concatenate([picture, picture]), load_upscaler("fast")
    fine, rounded = (upscale_pixels(network, pictures, keeps_fractions=keeps) for keeps in (True, False))
    assert fine.dtype == np.uint16
    assert rounded.dtype == dtype
    level = np.iinfo(np.uint16).max / np.iinfo(dtype).max
    assert np.abs(fine / level - rounded).max() <= 0.5 + 1e-3  # float32
    assert (fine % level != 0).mean() > 0.1 or level == 1


@pytest.mark.parametrize("dtype", DEPTHS)
def test_grey_is_the_mean_of_three_equal_channels(dtype):
    grey = make_noise(dtype, 1, 9, 8, 1)
    as_colour = upscale_pixels(load_upscaler("paper"), grey.repeat(3, axis=3)).astype(float).mean(axis=3, keepdims=True)
    assert np.abs(upscale_pixels(load_upscaler("paper"), grey) - as_colour).max() <= 1


def test_hidden_colours_do_not_bleed():
    picture = np.zeros((1, 8, 8, 4), np.uint8)
    picture[..., :4, :] = [255, 0, 0, 255]
    picture[..., 4:, :] = [0, 255, 0, 0]
    got = upscale_pixels(Bicubic(2), picture)
    shown = got[got[..., 3] > 0]
    assert (shown[:, 1] == 0).all()
    assert (shown[:, 0] >= 254).all()
    assert 0 < got[0, 0, 7, 3] < 255
    assert (got[got[..., 3] == 0] == 0).all()


@pytest.mark.parametrize("name", ["paper", "bicubic"])
@pytest.mark.parametrize("dtype", DEPTHS)
def test_alpha_is_exact_where_it_was_flat(name, dtype):
    peak = np.iinfo(dtype).max
    picture = make_noise(dtype, 1, 20, 20, 4)
    picture[..., 3] = 0
    picture[0, 5:15, 5:15, 3] = peak
    alpha = upscale_pixels(load_upscaler(name), picture)[0, ..., 3]
    assert (alpha[12:28, 12:28] == peak).all()
    outside = np.ones((40, 40), bool)
    outside[8:32, 8:32] = False
    assert (alpha[outside] == 0).all()


@pytest.mark.parametrize("channels", [2, 4])
def test_an_opaque_picture_comes_out_as_without_alpha(channels):
    picture = make_noise(np.uint8, 2, 6, 7, channels)
    picture[..., -1] = 255
    got = upscale_pixels(load_upscaler("paper"), picture)
    assert (got[..., -1] == 255).all()
    assert np.array_equal(
        got[..., :-1], upscale_pixels(load_upscaler("paper"), np.ascontiguousarray(picture[..., :-1]))
    )


def test_16_bits_stay_16_bits():
    ramp = np.broadcast_to(np.arange(1000, 1032, dtype=np.uint16), (1, 4, 32))[..., np.newaxis]
    got = upscale_pixels(Bicubic(2), ramp)[0, 4, 8:-8, 0]
    want = 1000 + (np.arange(64)[8:-8] + 0.5) / 2 - 0.5
    assert np.abs(got - want).max() <= 0.5


@pytest.mark.parametrize("dtype", DEPTHS)
@pytest.mark.parametrize(("levels", "more"), [(0.45, 0), (0.55, 1), (-0.45, 0), (-0.55, -1)])
def test_values_are_rounded_to_the_nearest(dtype, levels, more):
    class Brighter(Nearest):
        def __call__(self, images):
            return super().__call__(images) + np.float32(levels / np.iinfo(dtype).max)

    level = np.iinfo(dtype).max // 2 + 100  # all bits are used
    got = upscale_pixels(Brighter(2), np.full((1, 2, 2, 3), level, dtype))
    assert (got == level + more).all()


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_large_pictures_in_blocks_equal_the_whole(channels, monkeypatch):
    picture = make_noise(np.uint8, 3, 31, 45, channels)
    whole = upscale_pixels(Bicubic(3), picture)
    monkeypatch.setattr(pixels, "BLOCK_PIXELS", 120)
    assert np.array_equal(upscale_pixels(Bicubic(3), picture), whole)


@pytest.mark.parametrize("shape", [(4, 4, 3), (1, 4, 4, 5), (1, 4, 4, 0), (1, 0, 4, 3)])
def test_other_shapes(shape):
    with pytest.raises(InvalidImage, match="shape"):
        upscale_pixels(Nearest(2), np.zeros(shape, np.uint8))


def test_other_types():
    with pytest.raises(InvalidImage, match="int16"):
        upscale_pixels(Nearest(2), np.zeros((1, 2, 2, 3), np.int16))
