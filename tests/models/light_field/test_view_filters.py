"""Filters of views, against what they are for: a finer signal out of shifted samples."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="training.networks needs the training extra")

from ciir.models.light_field import view_filters
from ciir.models.light_field.view_filters import make_filters

TAPS = np.arange(-5, 6)
WINDOWS = [np.arange(5) - 2, np.arange(5), np.arange(3) - 2, np.arange(1)]


def filters_of(disparity, offsets, *, width=0.0, reach=1.6):
    """`(2, offsets, taps)` of one plane."""
    return make_filters(np.array([disparity]), np.array([width]), offsets, TAPS, reach=reach, phase=0.25)[0]


@pytest.mark.parametrize("offsets", WINDOWS, ids=len)
@pytest.mark.parametrize("disparity", [-2.0, -0.6, 0.0, 0.25, 1.15])
def test_each_filter_adds_up_to_1(offsets, disparity):
    found = filters_of(disparity, offsets, width=0.3)
    assert found.shape == (2, len(offsets), len(TAPS))
    np.testing.assert_allclose(found.sum((1, 2)), 1, atol=1e-12)


@pytest.mark.parametrize("offsets", WINDOWS, ids=len)
def test_samples_beyond_the_reach_are_not_used(offsets):
    found = filters_of(0.7, offsets)
    far = np.abs(TAPS - 0.7 * offsets[:, None]) > 1.6
    assert not found[:, far].any()
    assert found[:, ~far].all()


def test_views_without_disparity_are_repeated_samples(monkeypatch):
    """Five samples of one place are one sample of a fifth of the noise."""
    five = filters_of(0.0, WINDOWS[0])
    np.testing.assert_allclose(five, five[:, :1].repeat(5, axis=1), atol=1e-12)
    monkeypatch.setattr(view_filters, "NOISE", view_filters.NOISE / 5)
    np.testing.assert_allclose(five.sum(1), filters_of(0.0, np.arange(1))[:, 0], atol=1e-10)


@pytest.mark.parametrize("offsets", WINDOWS, ids=len)
def test_mirrored_views_have_mirrored_filters(offsets):
    """The signal mirrored: phases and taps change places, and either the disparity or the offsets their sign."""
    minus, plus = filters_of(0.4, offsets, width=0.2)
    for other in (filters_of(-0.4, offsets, width=0.2), filters_of(0.4, -offsets, width=0.2)):
        np.testing.assert_allclose(minus, other[1, :, ::-1], atol=1e-10)
        np.testing.assert_allclose(plus, other[0, :, ::-1], atol=1e-10)
    assert np.abs(minus - plus).max() > 0.05
    np.testing.assert_allclose(
        filters_of(-0.4, -offsets[::-1], width=0.2), filters_of(0.4, offsets, width=0.2)[:, ::-1], atol=1e-10
    )


def draw_signal(places, width):
    """A signal of random waves, some finer than samples 1 apart can show: its means over `width` around `places`."""
    random = np.random.default_rng(4)
    waves = zip(random.uniform(0.05, 0.7, 20), random.uniform(0, 2 * np.pi, 20), strict=True)
    return sum(np.sinc(often * width) * np.sin(2 * np.pi * often * places + phase) for often, phase in waves)


def reconstruct(disparity, offsets, **options):
    """The root mean square error of the fine signal out of samples of views at `offsets`."""
    middle = np.arange(400.0)
    samples = np.stack([draw_signal(middle[:, None] + TAPS - disparity * offset, 1.0) for offset in offsets], axis=1)
    found = np.einsum("nvt,pvt->np", samples, filters_of(disparity, offsets, **options))
    return np.sqrt(np.mean((found - draw_signal(middle[:, None] + np.array([-0.25, 0.25]), 0.5)) ** 2))


@pytest.mark.parametrize("offsets", WINDOWS[:3], ids=["middle", "border", "three"])
@pytest.mark.parametrize("disparity", [-0.6, 0.25, 0.4])
def test_views_make_a_finer_signal_than_one_view(offsets, disparity):
    middle = np.arange(400.0)
    samples = draw_signal(middle[:, None] + np.arange(-2, 3), 1.0)
    keys = np.array([-7, 105, 35, -5]) / 128  # cubic interpolation a quarter of a sample after the first middle one
    interpolated = np.stack([samples[:, :4] @ keys[::-1], samples[:, 1:] @ keys], axis=1)
    wanted = draw_signal(middle[:, None] + np.array([-0.25, 0.25]), 0.5)
    of_one = np.sqrt(np.mean((interpolated - wanted) ** 2))
    found = reconstruct(disparity, offsets)
    assert found < 0.6 * of_one
    assert found < 0.7 * reconstruct(disparity, np.arange(1))
    assert reconstruct(disparity, offsets, width=0.1) < 0.8 * of_one


def test_the_disparity_matters():
    """Filters for another disparity than the views have are no better than one view."""
    middle = np.arange(400.0)
    samples = np.stack([draw_signal(middle[:, None] + TAPS - 0.4 * offset, 1.0) for offset in WINDOWS[0]], axis=1)
    found = np.einsum("nvt,pvt->np", samples, filters_of(-0.4, WINDOWS[0]))
    error = np.sqrt(np.mean((found - draw_signal(middle[:, None] + np.array([-0.25, 0.25]), 0.5)) ** 2))
    assert error > 1.5 * reconstruct(0.4, WINDOWS[0])
