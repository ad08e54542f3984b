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


def test_intersections_with_a_slanted_layer():
    disparity, slope = 0.7, np.array([0.04, -0.03])
    found = planes.intersect_layer(*double(OFFSETS, disparity, slope)).apply(ALONG)
    for view, offset in enumerate(OFFSETS):
        for y, x in ((0, 0), (3, 17), (40, 22)):
            pixel = np.array([ALONG[y], ALONG[x]])
            np.testing.assert_allclose(found[view, y, x], met(offset, pixel, disparity, slope), atol=1e-12)


@pytest.mark.parametrize("change", [-0.7, 0.3, 2.0])
def test_width_of_a_fold_in_each_view(change):
    """A strip along a vertical edge at 1, over a flat layer of disparity 0.5: in each view from the layer's edge to
    where its own other edge is met, `width * (1 + change * u)` pixels away, or nowhere where that is no width at all.
    """
    width, edge, disparity = 1.5, 1.0, 0.5
    normal, flat = torch.tensor([0.0, 1.0], dtype=torch.float64), torch.zeros(2, dtype=torch.float64)
    fold = planes.Fold(normal, edge, change, width)
    steps = torch.arange(-2.0, 3.0, dtype=torch.float64)
    offsets = torch.cartesian_prod(steps, steps)
    along = (torch.arange(400, dtype=torch.float64) + 0.5) / 20 - 10
    seen = fold.coverage(along, offsets, torch.tensor(disparity, dtype=torch.float64), flat)
    for view, (_, u) in enumerate(offsets.tolist()):
        near = edge + disparity * u  # where the layer begins
        wanted = max(0.0, width * (1 + change * u))
        outside = seen[view, :, along < near]
        assert torch.equal(outside, outside[:1].expand_as(outside))
        assert outside[0].sum() / 20 == pytest.approx(wanted, abs=0.05)  # a pixel here is 0.05
        if wanted:
            assert seen[view, 0, (along > near) & (along < near + 0.05)].min() > 0.99
            assert seen[view, 0, along > near + 0.15].max() == 0
