"""Intersections of rays with layers against equations solved ray by ray, and the visible part of folds."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.data.light_field import planes

OFFSETS = np.array([(v, u) for v in (-2, 0, 1) for u in (-1, 0, 2)], float)
ALONG = torch.linspace(-10, 10, 41, dtype=torch.float64)


def met(offset, pixel, disparity, slope):
    """One ray: `p = q + (disparity + slope . q) * offset`, two linear equations for q."""
    return np.linalg.solve(np.eye(2) + np.outer(offset, slope), pixel - disparity * offset)


def double(*parts):
    return (torch.tensor(part, dtype=torch.float64) for part in parts)


def test_intersections_with_slanted_layers():
    disparities, slopes = np.array([0.7, -0.2]), np.array([[0.04, -0.03], [0.0, 0.06]])
    at = planes.intersect_layer(*double(OFFSETS, disparities, slopes))
    found = at.apply(ALONG)
    for scene, view in np.ndindex(2, len(OFFSETS)):
        for y, x in ((0, 0), (3, 17), (40, 22)):
            pixel = np.array([ALONG[y], ALONG[x]])
            wanted = met(OFFSETS[view], pixel, disparities[scene], slopes[scene])
            np.testing.assert_allclose(found[scene, view, y, x], wanted, atol=1e-12)
    assert torch.equal(at.select(3).apply(ALONG), found[:, 3:4])


def test_maps_follow_each_other():
    """For two scenes, with a matrix and a shift of each."""
    at = planes.intersect_layer(*double(OFFSETS, [0.7, -0.2], [[0.04, -0.03], [0.0, 0.06]]))
    matrix, shift = double([[[0.5, 2.0]], [[-1.0, 0.25]]], [[3.0], [-4.0]])
    found = at.compose(matrix, shift).apply(ALONG)
    wanted = torch.einsum("nmk,nvyxk->nvyxm", matrix, at.apply(ALONG)) + shift[:, None, None, None]
    torch.testing.assert_close(found, wanted)


@pytest.mark.parametrize("change", [-0.7, 0.3, 2.0])
def test_width_of_a_fold_in_each_view(change):
    """A strip along a vertical edge at 1, over a flat layer of disparity 0.5: in each view from the layer's edge to
    where its own other edge is met, `width * (1 + change * u)` pixels away, or nowhere where that is no width at all.
    """
    width, edge, disparity = 1.5, 1.0, 0.5
    fold = planes.Fold(*double([[0.0, 1.0]], [edge], [change], [width]))
    steps = torch.arange(-2.0, 3.0, dtype=torch.float64)
    offsets = torch.cartesian_prod(steps, steps)
    along = (torch.arange(400, dtype=torch.float64) + 0.5) / 20 - 10
    (seen,) = fold.coverage(along, offsets, *double([disparity], [[0.0, 0.0]]))
    for view, (_, u) in enumerate(offsets.tolist()):
        near = edge + disparity * u  # where the layer begins
        wanted = max(0.0, width * (1 + change * u))
        outside = seen[view, :, along < near]
        assert torch.equal(outside, outside[:1].expand_as(outside))
        assert outside[0].sum() / 20 == pytest.approx(wanted, abs=0.05)  # a pixel here is 0.05
        if wanted:
            assert seen[view, 0, (along > near) & (along < near + 0.05)].min() > 0.99
            assert seen[view, 0, along > near + 0.15].max() == 0


def test_folds_of_many_scenes_are_those_of_each():
    random, offsets = np.random.default_rng(0), torch.from_numpy(OFFSETS)
    angle = random.uniform(0, 2 * np.pi, 5)
    drawn = [np.stack([np.cos(angle), np.sin(angle)], -1), random.uniform(-3, 3, 5), *planes.draw_folds(random, 5)]
    of_layers = [torch.from_numpy(part) for part in (random.uniform(-1, 1, 5), random.uniform(-0.02, 0.02, (5, 2)))]
    parts = [torch.from_numpy(part.astype(float)) for part in drawn]
    together = planes.Fold(*parts).coverage(ALONG, offsets, *of_layers)
    assert 0 == together.min() < together.max() <= 1
    for scene in range(5):
        one = slice(scene, scene + 1)
        alone = planes.Fold(*(part[one] for part in parts)).coverage(ALONG, offsets, *(part[one] for part in of_layers))
        torch.testing.assert_close(alone, together[one])


def test_limits_of_drawn_folds():
    """Both directions, and no more than the largest change of disparity over the width."""
    change, width = planes.draw_folds(np.random.default_rng(1), 2000)
    size = np.abs(change)
    assert (planes.CHANGE[0] <= size.min(), size.max() <= planes.CHANGE[1]) == (True, True)
    assert 0.45 < (change > 0).mean() < 0.55
    assert 0 < width.min() < width.max() <= planes.WIDTH[1]
    assert (size * width).max() <= planes.MOST * (1 + 1e-6)
    middle = np.sqrt(np.prod(planes.CHANGE))
    assert 0.45 < (size < middle).mean() < 0.55  # evenly in the logarithm
