"""Interpolated within a bound: what a table says, and what becomes of pictures."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from models import bounded, catalogue
from models.baselines import Bicubic, Nearest
from models.pixels import upscale_pixels
from models.skip import NOTHING, Skipping, Tally

AROUND = 2


class Edgy(Nearest):
    """Each pixel repeated, and a table that says of edges what an edge costs."""

    card = SimpleNamespace(sha256="edgy")


@pytest.fixture
def edgy(monkeypatch):
    table = bounded.Table(np.array([0.5, 1e9]), np.array([0.01, 2e7]), AROUND)
    monkeypatch.setattr(bounded, "tables", lambda: {"edgy": table})
    return Edgy(2)


def picture(*, height=160, width=200, channels=3, dtype=np.uint8, seed=5):
    """A slope with a noisy corner."""
    peak = np.iinfo(dtype).max
    slope = np.linspace(0.1, 0.9, width)[None, :, None] * np.ones((height, 1, channels))
    noise = np.random.default_rng(seed).random((height // 3, width // 4, channels))
    slope[: height // 3, : width // 4] = noise
    return (slope * peak).round().astype(dtype)


def rms(one, other):
    return float(np.sqrt(np.mean(np.square(one.astype(float) - other))))


def test_a_table_is_interpolated_and_says_nothing_beyond_its_end():
    table = bounded.Table(np.array([1.0, 4.0, 16.0]), np.array([0.1, 0.4, 6.4]), 4)
    got = table.predicted(np.array([0, 1, 2, 4, 8, 16, 17], np.float32))
    assert np.allclose(got, [0.1, 0.1, 0.2, 0.4, 1.6, 6.4, np.inf])  # straight lines between logarithms


@pytest.mark.parametrize(("channels", "dtype"), [(3, np.uint8), (1, np.uint8), (3, np.uint16)])
def test_every_pixel_is_the_networks_or_interpolated(edgy, channels, dtype):
    some = np.stack([picture(channels=channels, dtype=dtype, seed=seed) for seed in (1, 2)])
    tally = Tally()
    got = upscale_pixels(edgy, some, skipping=Skipping(exact=False, max_error=1.0), tally=tally)
    by_network, by_cubic = (upscale_pixels(model, some) for model in (Nearest(2), Bicubic(2)))
    is_network, is_cubic = ((got == each).all(axis=3) for each in (by_network, by_cubic))
    assert (is_network | is_cubic).all()
    assert is_network[:, :100, :96].all()  # the noise
    assert is_cubic[:, 160:, 200:].all()
    assert 0.5 < tally.interpolated / tally.pixels < 0.9
    assert is_cubic.sum() >= 4 * tally.interpolated


def test_of_a_part_the_bound_is_over_the_picture(edgy):
    """Half of a picture may differ by twice the square."""
    some = picture()[None]
    few, many = Tally(), Tally()
    for of, tally in ((0, few), (100 * some.shape[1] * some.shape[2], many)):
        bounded.upscale(upscale_pixels, edgy, some, 2.0, tally, of=of)
    assert few.interpolated < many.interpolated


@pytest.mark.parametrize("case", ["alpha", "small", "no table", "interpolation"])
def test_what_goes_whole(edgy, case):
    some = picture(channels=4 if case == "alpha" else 3, width=20 if case == "small" else 40)[None]
    model = {"no table": catalogue.load("paper"), "interpolation": Bicubic(2)}.get(case, edgy)
    tally = Tally()
    got = upscale_pixels(model, some, skipping=Skipping(exact=False, max_error=16.0), tally=tally)
    assert np.array_equal(got, upscale_pixels(model, some, skipping=NOTHING))
    assert tally.interpolated == 0


def singles():
    return [entry for entry in catalogue.entries() if entry.card is not None and not entry.is_light_field]


@pytest.mark.parametrize("entry", singles(), ids=lambda entry: entry.name)
def test_every_shipped_network_has_a_table(entry):
    table = bounded.tables()[entry.card.sha256]
    assert len(table.scores) == len(table.errors) >= 10
    assert (np.diff(table.scores) > 0).all()
    assert (np.diff(table.errors) >= 0).all()
    assert (table.errors > 0).all()
    assert 0 < table.around <= entry.card.radius


@pytest.mark.parametrize("bound", [0.5, 2.0])
def test_a_networks_picture_differs_by_the_bound_at_most(bound):
    model = catalogue.load("fast")
    some = picture(height=256, width=320)[None]
    tally = Tally()
    got = upscale_pixels(model, some, skipping=Skipping(max_error=bound), tally=tally)
    assert tally.interpolated > 0.4 * tally.pixels
    assert 0 < rms(got, upscale_pixels(model, some, skipping=NOTHING)) <= bound


def test_without_a_bound_nothing_is_interpolated():
    some = picture(height=64, width=80)[None]
    tally = Tally()
    upscale_pixels(catalogue.load("fast"), some, skipping=replace(Skipping(), max_error=None), tally=tally)
    assert tally.interpolated == 0
