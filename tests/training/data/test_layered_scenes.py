"""Layered scenes: positions and occlusion of layers in each view."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.data import degrade, layered_scenes
from ciir.training.networks.plane_sweep import MOST, SIDE, PlaneSweep

WHOLE = torch.ones(SIDE)
PLANES = 17


def smooth(seed):
    """A picture whose details are of 10 texels, 8-bit RGB: no view of it is aliased."""
    knots = torch.rand(1, 3, 16, 16, generator=torch.Generator().manual_seed(seed))
    fine = torch.nn.functional.interpolate(knots, size=layered_scenes.TEXTURE, mode="bicubic", align_corners=False)
    return fine[0].clamp(0, 1).mul(255).byte().permute(1, 2, 0).numpy()


PICTURES = [smooth(0), smooth(1)]


def scenes(count=2, *, seed=0, side=24, pictures=PICTURES):
    return layered_scenes.make_scenes(np.random.default_rng(seed), pictures, count, side=side, window=SIDE)


@pytest.fixture
def layers(monkeypatch):
    """Scenes of layers at these disparities from back to front, flat, none of one colour."""
    monkeypatch.setattr(layered_scenes, "PLAIN", 0.0)
    monkeypatch.setattr(layered_scenes, "FLAT", 0.0)

    def set_to(*disparities):
        monkeypatch.setattr(layered_scenes, "LAYERS", (len(disparities),) * 2)

        def places(_, count, side):
            return torch.tensor(disparities).expand(count, -1), torch.zeros(count, len(disparities), 2)

        monkeypatch.setattr(layered_scenes, "_draw_disparities", places)

    return set_to


def test_the_middle_view_is_the_luma_of_its_colours():
    views, colours = scenes(6)
    wanted = torch.einsum("nchw,c->nhw", colours, torch.tensor(layered_scenes.LUMA))
    torch.testing.assert_close(views[:, SIDE**2 // 2], wanted, atol=1e-5, rtol=0)  # float32 in another order


@pytest.mark.parametrize("disparity", [-1.5, -0.5, 0.25, 1.0])
def test_content_moves_down_and_right_by_the_disparity(layers, disparity):
    """Whole fine samples, so that each view is the middle one, moved."""
    layers(disparity)
    views, _ = scenes()
    grid = views.unflatten(1, (SIDE, SIDE))
    steps, margin = round(disparity * layered_scenes.FINE), 2 * abs(round(disparity * layered_scenes.FINE))
    inner = (..., slice(margin, -margin), slice(margin, -margin))
    for v in range(SIDE):
        for u in range(SIDE):
            moved = grid[:, 2, 2].roll(((v - 2) * steps, (u - 2) * steps), (1, 2))
            torch.testing.assert_close(grid[:, v, u][inner], moved[inner], atol=1e-4, rtol=0)  # float32 places


@pytest.mark.parametrize("disparity", [-1.25, -0.5, 0.75, 1.5])
def test_the_sweep_finds_a_flat_layer(layers, disparity):
    layers(disparity)
    low = degrade.box(scenes()[0], layered_scenes.FINE)
    _, spread = PlaneSweep(PLANES)(low, WHOLE, WHOLE)
    inner = spread[:, :, 6:-6, 6:-6].mean((2, 3))
    assert inner.argmin(1).tolist() == [(disparity + MOST) / (2 * MOST) * (PLANES - 1)] * 2


def test_the_nearer_layer_covers_the_further(layers, monkeypatch):
    """A white layer, right of the middle, over a black one: its edge moves by its disparity."""
    layers(-1.0, 0.75)
    textures = iter([torch.zeros(3, 160, 160), torch.ones(3, 160, 160)])
    monkeypatch.setattr(layered_scenes, "_draw_texture", lambda random, pictures: next(textures))
    step = torch.where(torch.arange(layered_scenes.MASK) < layered_scenes.MASK // 2, -1e4, 1e4)
    monkeypatch.setattr(layered_scenes, "_draw_mask", lambda random: (step.expand(1, layered_scenes.MASK, -1), None))
    views, colours = scenes(1)
    at = torch.arange(24 * layered_scenes.FINE)
    for view, seen in enumerate(views[0]):
        edge = 12 * layered_scenes.FINE + 3 * (view % SIDE - 2)  # 0.75 LR pixels are 3 fine samples
        torch.testing.assert_close(seen, (at >= edge).float().expand_as(seen), atol=1e-4, rtol=0)
    torch.testing.assert_close(colours[0], views[0, 12].expand(3, -1, -1), atol=1e-4, rtol=0)


def test_a_fold_begins_where_its_layer_ends(layers, monkeypatch):
    """A white layer over a black one, and the fold grey: no black is visible between them in any view."""
    layers(-0.5, 0.75)
    monkeypatch.setattr(layered_scenes, "STRAIGHT", 1.0)
    monkeypatch.setattr(layered_scenes, "FOLDED", 1.0)
    for seed in range(12):
        shades = iter([0.0, 1.0, 0.5])

        def texture(random, pictures, shades=shades):
            return torch.full((3, 160, 160), next(shades))

        monkeypatch.setattr(layered_scenes, "_draw_texture", texture)
        views, _ = scenes(1, seed=seed)
        dark = (views[0] < 0.1).float()[:, None]
        light = (views[0] > 0.9).float()[:, None]
        grey = ((views[0] - 0.5).abs() < 0.1).float()
        # Where the strip is two fine samples wide, black and white are never as near as that.
        wide = grey.flatten(1).sum(1) > 3 * 24 * layered_scenes.FINE
        near = torch.nn.functional.max_pool2d(dark, 3, 1, 1) * light
        assert near[wide].sum() == 0, seed


def test_disparities_are_ordered_and_limited(monkeypatch):
    random = np.random.default_rng(0)

    def uniform(low, high, *shape):
        return torch.from_numpy(random.uniform(low, high, shape).astype(np.float32))

    disparity, slope = layered_scenes._draw_disparities(uniform, 2000, 30)
    step = disparity.diff(dim=1)
    rising, falling = (step >= 0).all(1), (step <= 0).all(1)
    assert (rising | falling).all()
    assert 0.4 < rising.float().mean() < 0.6
    beyond = (disparity.abs() > MOST).any(1).float().mean()
    assert 0 < beyond < layered_scenes.BEYOND
    assert disparity.abs().max() <= 4 * MOST
    assert (1 - 2 * slope.abs().sum(-1)).min() > 0  # no ray of any view of the window runs along a layer
    monkeypatch.setattr(layered_scenes, "BEYOND", 0.0)
    disparity, slope = layered_scenes._draw_disparities(uniform, 2000, 30)
    at_the_edge = disparity.abs() + slope.abs().amax(-1) * 15
    assert at_the_edge.max() <= MOST + 1e-5
