"""How well each order explains tiles: small disparities by slopes of brightness."""

import numpy as np
import pytest

from ciir.renderer.view_order.evidence import AROUND, ORDERS, REACH, TILE, fit_slopes


def make_tiles(motion, *, noise=0.0, count=6):
    """Tiles of a smooth texture and its neighbouring views, whose content moves by `motion(step)`, (down, across)."""
    random = np.random.default_rng(0)
    side = TILE + 2 * REACH
    rows, cols = np.indices((side, side)) - REACH
    waves = [(random.uniform(0.1, 0.5, 2) * random.choice([-1, 1], 2), random.uniform(0, 6)) for _ in range(5 * count)]

    def draw(down, across):
        pictures = [np.sin(a * (rows - down) + b * (cols - across) + phase) for (a, b), phase in waves]
        tiles = 0.5 + 0.05 * np.reshape(pictures, (count, 5, side, side)).sum(axis=1)
        return (tiles + noise * random.standard_normal(tiles.shape)).astype(np.float32)

    return draw(0, 0)[:, REACH:-REACH, REACH:-REACH], np.stack([draw(*motion(step)) for step in AROUND], axis=1)


MOTIONS = {
    "as given": lambda step: (0.2 * step[0], 0.2 * step[1]),
    "reversed along one axis": lambda step: (-0.2 * step[0], 0.2 * step[1]),
    "transposed": lambda step: (0.2 * step[1], 0.2 * step[0]),
    "transposed and reversed along one axis": lambda step: (-0.2 * step[1], 0.2 * step[0]),
}


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_one_disparity_explains_all_in_the_right_order(order, noise):
    shares = fit_slopes(*make_tiles(MOTIONS[order], noise=noise))
    assert (shares.argmax(axis=1) == ORDERS.index(order)).all()
    assert (shares.max(axis=1) > 0.9).all()


def test_a_motion_that_no_order_has_is_explained_by_none():
    assert fit_slopes(*make_tiles(lambda step: (0, 0.05 * step[1] + 0.15 * step[0]))).max() < 0.9


@pytest.mark.parametrize(
    ("motion", "noise"), [(lambda _: (0, 0), 0.01), (lambda step: (3 * step[0], 3 * step[1]), 0.0)]
)
def test_noise_and_large_disparities_are_not_explained(motion, noise):
    assert fit_slopes(*make_tiles(motion, noise=noise)).max() < 0.9


def test_flat_tiles_are_not_explained():
    flat = (
        np.full((2, TILE, TILE), 0.5, np.float32),
        np.full((2, 8, TILE + 2 * REACH, TILE + 2 * REACH), 0.5, np.float32),
    )
    assert (fit_slopes(*flat) == 0).all()
