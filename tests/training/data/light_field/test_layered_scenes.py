"""Layered scenes: positions and occlusion of layers in each view."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.models.light_field.windows import select_axis
from ciir.training.data.light_field import layered_scenes
from ciir.training.data.light_field.layered_scenes import MOST
from ciir.training.networks.plane_sweep import PLANES, SIDE, PlaneSweep
from tests.training import degradations

MIDDLE = (SIDE // 2, SIDE // 2)
OWN = [MIDDLE, (0, 3)]


def smooth(seed):
    """A picture whose details are of 10 texels, 8-bit RGB: no view of it is aliased."""
    knots = torch.rand(1, 3, 16, 16, generator=torch.Generator().manual_seed(seed))
    fine = torch.nn.functional.interpolate(knots, size=layered_scenes.TEXTURE, mode="bicubic", align_corners=False)
    return fine[0].clamp(0, 1).mul(255).byte().permute(1, 2, 0).numpy()


PICTURES = [smooth(0), smooth(1)]


def scenes(count=2, *, seed=0, side=24, own=MIDDLE):
    return layered_scenes.make_scenes(np.random.default_rng(seed), PICTURES, count, side=side, window=SIDE, own=own)


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


@pytest.mark.parametrize("own", OWN)
def test_the_view_itself_is_the_luma_of_its_colours(own):
    views, colours = scenes(6, own=own)
    wanted = torch.einsum("nchw,c->nhw", colours, torch.tensor(layered_scenes.LUMA))
    torch.testing.assert_close(views[:, own[0] * SIDE + own[1]], wanted, atol=1e-5, rtol=0)  # float32 in another order


@pytest.mark.parametrize("disparity", [-1.5, -0.5, 0.25, 1.0])
@pytest.mark.parametrize("own", OWN)
def test_content_moves_down_and_right_by_the_disparity(layers, disparity, own):
    """Whole fine samples, so that each view is the own one, moved."""
    layers(disparity)
    views, _ = scenes(own=own)
    grid = views.unflatten(1, (SIDE, SIDE))
    steps = round(disparity * layered_scenes.FINE)
    margin = (SIDE - 1) * abs(steps)
    inner = (..., slice(margin, -margin), slice(margin, -margin))
    for v in range(SIDE):
        for u in range(SIDE):
            moved = grid[:, *own].roll(((v - own[0]) * steps, (u - own[1]) * steps), (1, 2))
            torch.testing.assert_close(grid[:, v, u][inner], moved[inner], atol=1e-4, rtol=0)  # float32 places


@pytest.mark.parametrize("disparity", [-1.15, -0.4, 0.0, 0.85, 1.55])
@pytest.mark.parametrize("own", OWN)
def test_the_sweep_finds_a_flat_layer(layers, disparity, own):
    layers(disparity)
    low = degradations.box(scenes(own=own)[0], layered_scenes.FINE)
    rows, cols = (torch.from_numpy(select_axis(at, SIDE).present) for at in own)
    _, spread = PlaneSweep()(low, rows, cols)
    inner = spread[:, :, 8:-8, 8:-8].mean((2, 3))
    planes = [*(-plane for plane in PLANES[::-1]), 0.0, *PLANES]
    assert inner.argmin(1).tolist() == [planes.index(disparity)] * 2


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
    monkeypatch.setattr(layered_scenes, "STRIPED", 0.0)
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
    assert (1 - (SIDE - 1) * slope.abs().sum(-1)).min() > 0  # no ray of any view of the window runs along a layer
    monkeypatch.setattr(layered_scenes, "BEYOND", 0.0)
    disparity, slope = layered_scenes._draw_disparities(uniform, 2000, 30)
    at_the_edge = disparity.abs() + slope.abs().amax(-1) * 15
    assert at_the_edge.max() <= MOST + 1e-5


def test_most_scenes_have_small_disparities():
    random = np.random.default_rng(1)

    def uniform(low, high, *shape):
        return torch.from_numpy(random.uniform(low, high, shape).astype(np.float32))

    largest = layered_scenes._draw_disparities(uniform, 2000, 30)[0].abs().amax(1)
    assert (largest < 0.3).float().mean() > 0.25
    assert (largest > 1).float().mean() > 0.25


@pytest.mark.parametrize("seed", range(6))
def test_stripes_are_thin_bars(seed, monkeypatch):
    """Along each line across them a mask of stripes is above its threshold in a few short runs."""
    monkeypatch.setattr(layered_scenes, "STRIPED", 1.0)
    mask, normal = layered_scenes._draw_mask(np.random.default_rng(seed))
    assert normal is None
    assert mask.shape == (1, layered_scenes.MASK, layered_scenes.MASK)
    assert mask.max() <= 1
    share = float((mask > 0).float().mean())
    assert 0.01 < share < 0.5


def test_plain_backgrounds(monkeypatch):
    """Of the colours of `draw_background`, the same in all views."""
    monkeypatch.setattr(layered_scenes, "LAYERS", (1, 1))
    monkeypatch.setattr(layered_scenes, "PLAIN", 1.0)
    monkeypatch.setattr(layered_scenes, "draw_background", lambda random: (255, 51, 0))
    views, colours = scenes(1)
    torch.testing.assert_close(colours[0], torch.tensor([1, 0.2, 0])[:, None, None].expand_as(colours[0]))
    assert (views - float(torch.tensor(layered_scenes.LUMA) @ torch.tensor([1, 0.2, 0]))).abs().max() < 1e-6
