"""Interpolated within a bound: the scores, the choice of windows, and what becomes of pictures."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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


def score_by_loops(some):
    """The same as `edge_scores`, pixel by pixel."""
    height, width, channels = some.shape
    levels = some.astype(float) * 255 / np.iinfo(some.dtype).max
    taps = (1, -4, 6, -4, 1)

    def at(row, col, channel):
        return levels[min(max(row, 0), height - 1), min(max(col, 0), width - 1), channel]

    rows, cols = -(-height // bounded.CELL), -(-width // bounded.CELL)
    values = [[[] for _ in range(cols)] for _ in range(rows)]
    for row in range(height):
        for col in range(width):
            for channel in range(channels):
                down = sum(tap * at(row + i - 2, col, channel) for i, tap in enumerate(taps))
                across = sum(tap * at(row, col + i - 2, channel) for i, tap in enumerate(taps))
                values[row // bounded.CELL][col // bounded.CELL].append(down**2 + across**2)
    return np.array([[np.mean(cell) for cell in line] for line in values])


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.integers(1, 19), st.integers(1, 19), st.sampled_from([1, 3]), st.sampled_from([np.uint8, np.uint16]))
def test_scores_are_the_mean_square_of_fourth_differences(height, width, channels, dtype):
    some = np.random.default_rng(height * width).integers(0, np.iinfo(dtype).max, (height, width, channels), dtype)
    # Sums of some hundred squares up to 1e7 in float32.
    assert np.allclose(bounded.edge_scores(some), score_by_loops(some), rtol=1e-4, atol=1e-2)


def test_scores_in_bands_are_those_of_the_whole(monkeypatch):
    some = picture(height=75, width=61)
    whole = bounded.edge_scores(some)
    monkeypatch.setattr(bounded, "BAND", 61 * 16)
    assert np.array_equal(bounded.edge_scores(some), whole)


def test_a_table_is_interpolated_and_says_nothing_beyond_its_end():
    table = bounded.Table(np.array([1.0, 4.0, 16.0]), np.array([0.1, 0.4, 6.4]), 4)
    got = table.predicted(np.array([0, 1, 2, 4, 8, 16, 17], np.float32))
    assert np.allclose(got, [0.1, 0.1, 0.2, 0.4, 1.6, 6.4, np.inf])  # straight lines between logarithms


@settings(max_examples=80, deadline=None, derandomize=True)
@given(st.integers(1, 150), st.integers(1, 150), st.integers(0, 9), st.floats(0.001, 300), st.integers(0, 9))
def test_windows_keep_the_budget_and_see_around(height, width, around, budget, seed):
    random = np.random.default_rng(seed)
    shape = (-(-height // bounded.CELL), -(-width // bounded.CELL))
    cells = random.exponential(1, shape) * (random.random(shape) < 0.3)
    if seed == 0:
        cells[0, 0] = np.inf  # beyond what was learnt
    found = bounded.windows(cells, height, width, around, budget)
    if found is None:
        return
    by_network = np.zeros((height, width), int)
    for window in found:
        (top, bottom), (left, right) = window.rows, window.cols
        by_network[top:bottom, left:right] += 1
        assert window.kept == (bottom - top) * (right - left) > 0
        assert max(0, top - around) >= window.top >= 0
        assert max(0, left - around) >= window.left >= 0
        assert min(height, bottom + around) <= window.top + window.height <= height
        assert min(width, right + around) <= window.left + window.width <= width
    assert by_network.max(initial=0) <= 1
    skipped = by_network[:: bounded.CELL, :: bounded.CELL] == 0
    assert cells[skipped].sum() <= budget * (1 + 1e-9)


def test_a_price_finds_most_of_what_can_be_skipped():
    """One corner holds all of the error: what is computed is little more than it."""
    cells = np.full((32, 32), 0.01)
    cells[:8, :8] = 50
    (window,) = bounded.windows(cells, 256, 256, 8, budget=20)
    assert (window.rows, window.cols) == ((0, 64), (0, 64))


def test_nothing_is_run_where_all_is_below_the_bound():
    assert bounded.windows(np.full((8, 8), 0.1), 64, 64, 8, budget=7) == []


def test_a_picture_full_of_detail_goes_whole():
    assert bounded.windows(np.full((32, 32), 50.0), 256, 256, 8, budget=20) is None


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
