"""Layered scenes: positions and occlusion of layers in each view."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.models.light_field.planes import Range, describe_window, place_planes
from ciir.models.light_field.windows import WINDOW_SIDE as SIDE
from ciir.models.light_field.windows import select_axis
from ciir.training.data.light_field import layered_scenes, planes
from ciir.training.data.light_field.layered_scenes import MASK
from ciir.training.data.light_field.textures import TEXTURE
from ciir.training.networks.plane_sweep import PlaneSweep
from tests.training import degradations

MIDDLE = (SIDE // 2, SIDE // 2)
OWN = [MIDDLE, (0, 3)]
RANGE = Range(-1.0, 1.25)
PLANES = place_planes(RANGE, 10).tolist()


def smooth(seed):
    """A picture whose details are of 10 texels, `(3, TEXTURE, TEXTURE)` in [0, 1]: no view of it is aliased."""
    knots = torch.rand(1, 3, 16, 16, generator=torch.Generator().manual_seed(seed))
    fine = torch.nn.functional.interpolate(knots, size=TEXTURE, mode="bicubic", align_corners=False)
    return fine[0].clamp(0, 1)


class Drawn:
    """Textures of smooth pictures, or the given ones for each scene: its layers from back to front."""

    def __init__(self, *given):
        self.given = given or (smooth(0), smooth(1))

    def cut(self, random, count):
        return torch.stack([self.given[number % len(self.given)] for number in range(count)])


def shades(*levels):
    """One grey for each layer."""
    return Drawn(*(torch.full((3, TEXTURE, TEXTURE), level) for level in levels))


def scenes(count=2, *, seed=0, side=24, own=MIDDLE, textures=None):
    given = {"side": side, "window": SIDE, "own": own, "disparities": RANGE}
    return layered_scenes.make_scenes(np.random.default_rng(seed), textures or Drawn(), count, **given)


@pytest.fixture
def layers(monkeypatch):
    """Scenes of layers at these disparities from back to front, flat, none of one colour or overexposed."""
    monkeypatch.setattr(layered_scenes, "PLAIN", 0.0)
    monkeypatch.setattr(layered_scenes, "FLAT", 0.0)
    monkeypatch.setattr(layered_scenes, "BRIGHT", (0.0, 1.0))

    def set_to(*disparities):
        monkeypatch.setattr(layered_scenes, "LAYERS", (len(disparities),) * 2)

        def places(random, count, side, of):
            assert of == RANGE
            return np.tile(disparities, (count, 1)), np.zeros((count, len(disparities), 2))

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


@pytest.mark.parametrize("disparity", [-1.0, -0.5, 0.0, 0.75, 1.25])
@pytest.mark.parametrize("own", OWN)
def test_the_sweep_finds_a_flat_layer(layers, disparity, own):
    layers(disparity)
    low = degradations.box(scenes(own=own)[0], layered_scenes.FINE)
    window = describe_window(*(select_axis(at, SIDE) for at in own), RANGE, len(PLANES))
    _, spread = PlaneSweep()(low, *(torch.from_numpy(of.copy()) for of in (window.down, window.across)))
    inner = spread[:, :, 8:-8, 8:-8].mean((2, 3))
    assert inner.argmin(1).tolist() == [PLANES.index(disparity)] * 2


def test_the_nearer_layer_covers_the_further(layers, monkeypatch):
    """A white layer, right of the middle, over a black one: its edge moves by its disparity."""
    layers(-1.0, 0.75)
    step = torch.where(torch.arange(MASK) < MASK // 2, -1e4, 1e4)

    def masks(random, count):
        return step.expand(count, 1, MASK, MASK), np.zeros((count, 2)), np.zeros(count, bool)

    monkeypatch.setattr(layered_scenes, "_draw_masks", masks)
    views, colours = scenes(1, textures=shades(0.0, 1.0))
    at = torch.arange(24 * layered_scenes.FINE)
    for view, seen in enumerate(views[0]):
        edge = 12 * layered_scenes.FINE + 3 * (view % SIDE - 2)  # 0.75 LR pixels are 3 fine samples
        torch.testing.assert_close(seen, (at >= edge).float().expand_as(seen), atol=1e-4, rtol=0)
    torch.testing.assert_close(colours[0], views[0, 12].expand(3, -1, -1), atol=1e-4, rtol=0)


@pytest.fixture
def folded(layers, monkeypatch):
    """Two layers with a fold at a straight edge of the nearer one."""
    layers(-0.5, 0.75)
    monkeypatch.setattr(layered_scenes, "STRIPED", 0.0)
    monkeypatch.setattr(layered_scenes, "STRAIGHT", 1.0)
    monkeypatch.setattr(layered_scenes, "FOLDED", 1.0)


BLACK_WHITE = (0.0, 1.0, 0.0, 0.5)
"""Two scenes: the first is a white layer over a black one. Its fold has the other's shade, grey."""


def test_a_fold_begins_where_its_layer_ends(folded):
    """No black is visible between the layer and the fold in any view."""
    found = 0
    for seed in range(12):
        views, _ = scenes(seed=seed, textures=shades(*BLACK_WHITE))
        dark = (views[0] < 0.1).float()[:, None]
        light = (views[0] > 0.9).float()[:, None]
        grey = ((views[0] - 0.5).abs() < 0.1).float()
        # Where the strip is two fine samples wide, black and white are never as near as that.
        wide = grey.flatten(1).sum(1) > 3 * 24 * layered_scenes.FINE
        near = torch.nn.functional.max_pool2d(dark, 3, 1, 1) * light
        assert near[wide].sum() == 0, seed
        found += int(wide.sum())
    assert found > 50


def test_a_fold_is_invisible_from_behind(folded, monkeypatch):
    """At an upright edge a fold that approaches by 0.8 a pixel is narrower to one side and wider to the other."""
    upright = torch.linspace(-1, 1, MASK).expand(MASK, MASK)

    def masks(random, count):
        normal = np.tile([0.0, 1.0], (count, 1))
        return upright.expand(count, 1, MASK, MASK), normal, np.ones(count, bool)

    def folds(random, count):
        return np.full(count, 0.8, np.float32), np.full(count, 1.0, np.float32)

    monkeypatch.setattr(layered_scenes, "_draw_masks", masks)
    monkeypatch.setattr(planes, "draw_folds", folds)
    views, _ = scenes(textures=shades(*BLACK_WHITE), side=32)
    grey = ((views[0] - 0.5).abs() < 0.1).float().unflatten(0, (SIDE, SIDE))
    width = grey.sum((2, 3)) / grey.shape[2] / layered_scenes.FINE  # LR pixels
    for row in width:
        assert row.tolist() == pytest.approx([0, 0.2, 1, 1.8, 2.6], abs=2 / layered_scenes.FINE)
    assert width[:, 0].max() == 0


def test_scenes_of_fewer_layers_lack_the_nearest(layers, monkeypatch):
    layers(-1.0, -0.5, 0.0, 0.5, 1.0)
    monkeypatch.setattr(layered_scenes, "LAYERS", (2, 5))
    monkeypatch.setattr(layered_scenes, "FOLDED", 0.0)
    views, _ = scenes(24, textures=shades(0.0, 0.25, 0.5, 0.75, 1.0))
    most = views.flatten(1).amax(1)
    shown = sorted(set(most.mul(4).round().int().tolist()))
    assert shown == [1, 2, 3, 4]


def test_some_layers_are_overexposed(layers, monkeypatch):
    layers(0.0)
    before, _ = scenes(1)
    monkeypatch.setattr(layered_scenes, "BRIGHT", (1.0, 3.0))
    _, colours = scenes(4, seed=1)
    assert before.max() < 1
    share = (colours == 1).float().flatten(1).mean(1)
    assert share.max() > 0.1
    assert colours.max() == 1


def test_disparities_are_ordered_and_within_the_range(monkeypatch):
    middle, half = 0.125, 1.125

    def draw():
        disparity, slope = layered_scenes._draw_disparities(np.random.default_rng(0), 2000, 30, RANGE)
        return (disparity - middle) / half, slope / half

    place, slope = draw()
    step = np.diff(place, axis=1)
    rising, falling = (step >= 0).all(1), (step <= 0).all(1)
    assert (rising | falling).all()
    assert 0.4 < rising.mean() < 0.6
    beyond = (np.abs(place) > 1 + 1e-9).any(1).mean()
    assert 0 < beyond < layered_scenes.BEYOND
    assert np.abs(place).max() <= 4
    assert (1 - (SIDE - 1) * half * np.abs(slope).sum(-1)).min() > 0  # no ray of any view runs along a layer
    monkeypatch.setattr(layered_scenes, "BEYOND", 0.0)
    place, slope = draw()
    assert (np.abs(place) + np.abs(slope).max(-1) * 15).max() <= 1 + 1e-5  # at the edge of the picture


def test_some_scenes_have_layers_close_together_anywhere_in_the_range():
    disparity, _ = layered_scenes._draw_disparities(np.random.default_rng(1), 2000, 30, Range(-1.0, 1.0))
    width, middle = np.ptp(disparity, axis=1), disparity.mean(1)
    narrow = width < 0.1
    assert 0.08 < narrow.mean() < layered_scenes.NARROW
    assert (middle[narrow].min() < -0.7, middle[narrow].max() > 0.7) == (True, True)
    assert (width > 0.8).mean() > 0.1


@pytest.mark.parametrize("seed", range(6))
def test_stripes_are_thin_bars(seed, monkeypatch):
    """A mask of stripes is above its threshold in a small part."""
    monkeypatch.setattr(layered_scenes, "STRIPED", 1.0)
    masks, _, straight = layered_scenes._draw_masks(np.random.default_rng(seed), 5)
    assert not straight.any()
    assert masks.shape == (5, 1, MASK, MASK)
    assert masks.max() <= 1
    share = (masks > 0).float().mean((1, 2, 3))
    assert 0.01 < share.min() <= share.max() < 0.5


def test_straight_edges_have_their_normal():
    """Other masks are neither straight nor alike."""
    masks, normal, straight = layered_scenes._draw_masks(np.random.default_rng(0), 400)
    assert straight.mean() == pytest.approx(layered_scenes.STRAIGHT, abs=0.08)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1)
    slopes = torch.stack([masks[:, 0].diff(dim=axis).mean((1, 2)) for axis in (1, 2)], 1) * (MASK - 1) / 2
    np.testing.assert_allclose(slopes[straight], normal[straight], atol=1e-5)
    others = masks[~straight]
    assert len(torch.unique(others.flatten(1), dim=0)) == len(others)
    assert others.std((2, 3)).min() > 0.05


def test_plain_backgrounds(monkeypatch):
    """Of the colours of `draw_background`, the same in all views."""
    monkeypatch.setattr(layered_scenes, "LAYERS", (1, 1))
    monkeypatch.setattr(layered_scenes, "PLAIN", 1.0)
    monkeypatch.setattr(layered_scenes, "draw_background", lambda random: (255, 51, 0))
    views, colours = scenes(1)
    torch.testing.assert_close(colours[0], torch.tensor([1, 0.2, 0])[:, None, None].expand_as(colours[0]))
    assert (views - float(torch.tensor(layered_scenes.LUMA) @ torch.tensor([1, 0.2, 0]))).abs().max() < 1e-6
