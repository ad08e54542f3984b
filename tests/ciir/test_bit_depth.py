"""16-bit pictures of which cameras filled a part."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.bit_depth import (
    count_raised_bits,
    count_unused_bits,
    count_unused_camera_bits,
    lower_levels,
    raise_levels,
    round_to_depth,
)
from ciir.models import catalogue
from ciir.models.light_field.views import upscale_views
from ciir.models.single.pixels import upscale_pixels


@pytest.mark.parametrize(
    ("largest", "unused"), [(65535, 0), (32768, 0), (32767, 1), (4095, 4), (1023, 6), (200, 8), (0, 8)]
)
def test_unused_bits_are_counted(largest, unused):
    picture = np.array([[[0, largest, 0]]], np.uint16)
    assert count_unused_bits(picture) == unused
    assert count_unused_bits(picture, np.full((1, 1, 3), 65535, np.uint16)) == 0


@pytest.mark.parametrize(("largest", "unused"), [(65535, 0), (30000, 0), (4095, 4), (1800, 4), (1023, 6), (200, 8)])
def test_cameras_have_an_even_number_of_bits(largest, unused):
    assert count_unused_camera_bits(np.array([[[0, largest, 0]]], np.uint16)) == unused


def test_8_bits_are_all_used_and_alpha_does_not_count():
    assert count_unused_bits(np.zeros((2, 2, 3), np.uint8)) == 0
    assert count_unused_bits(np.array([[[1023, 65535]]], np.uint16)) == 6
    assert count_unused_bits(np.array([[[9, 9, 1023, 65535]]], np.uint16)) == 6


@pytest.mark.parametrize(("largest", "raised"), [(255, 0), (64, 0), (63, 2), (31, 3), (1, 7), (0, 7)])
def test_dark_8_bits_are_raised(largest, raised):
    picture = np.array([[[0, largest, 0, 255]]], np.uint8)
    assert count_raised_bits(picture) == raised
    assert count_raised_bits(picture, np.full((1, 1, 4), 200, np.uint8)) == 0
    assert np.array_equal(lower_levels(raise_levels(picture, raised), raised), picture)
    full = lower_levels(np.full((1, 1, 1), 255, np.uint8), raised)
    assert full.item() == 2 ** (8 - raised) - 1
    assert count_raised_bits(np.array([[[0, 1023, 0]]], np.uint16)) == 6


@given(st.integers(0, 8), st.integers(0, 2**16 - 1), st.sampled_from([1, 2, 3, 4]))
def test_lowering_undoes_raising_and_rounds(unused, level, channels):
    level >>= unused
    picture = np.full((1, 1, channels), level, np.uint16)
    raised = raise_levels(picture, unused)
    colours = channels - 1 if channels in (2, 4) else channels
    assert (raised[..., :colours] == level << unused).all()
    assert (raised[..., colours:] == level).all()
    assert np.array_equal(lower_levels(raised.copy(), unused), picture)
    most = 2 ** (16 - unused) - 1
    lowered = lower_levels(np.full((1, 1, 1), 65535, np.uint16), unused)
    assert lowered.item() == most


def test_16_bits_are_rounded_to_8():
    every = np.arange(2**16, dtype=np.uint16)
    rounded = round_to_depth(every, np.dtype(np.uint8))
    assert rounded.dtype == np.uint8
    assert np.abs(rounded - every / 257).max() < 0.5 + 1 / 500
    assert np.array_equal(rounded[::257], np.arange(256))
    assert round_to_depth(every, every.dtype) is every


@pytest.mark.parametrize("bits", [10, 12, 5])
def test_networks_make_of_few_bits_what_they_make_of_all(bits):
    rows, cols = np.mgrid[:24, :24]
    views = {
        (v, u): np.rint((0.5 + 0.45 * np.sin(rows / 2 + v / 3) * np.cos(cols / 3 + u / 4)) * (2**bits - 1))[
            ..., np.newaxis
        ].astype(np.uint8 if bits < 8 else np.uint16)
        for v in range(3)
        for u in range(3)
    }
    unused = 8 * views[0, 0].itemsize - bits
    full = {view: picture << unused for view, picture in views.items()}
    fallback = catalogue.load_upscaler("fast")
    network = catalogue.load_light_field_network("field")
    for make in (
        lambda given: upscale_pixels(fallback, given[1, 1][np.newaxis])[0],
        lambda given: upscale_views(network, fallback, given, [(1, 1), (0, 0)], (3, 3))[0][0],
    ):
        got, want = make(views), make(full)
        rounding = 0.5 / 2**unused if bits < 8 else 0  # of `want`, to 8 bits
        assert np.abs(got - want / 2**unused).max() <= 0.5 + rounding  # rounded to its levels
