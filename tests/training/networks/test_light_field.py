"""The light-field generator."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.models.light_field.windows import select_axis
from ciir.training.networks.collapsible import collapse
from ciir.training.networks.light_field import LightFieldGenerator, fold_factors, merge_layers
from ciir.training.networks.plane_sweep import SIDE


def test_missing_views_are_ignored():
    network = LightFieldGenerator((8, 8), width=8, depth=1)
    generator = torch.Generator().manual_seed(3)
    image, around = torch.rand(1, 3, 9, 7, generator=generator), torch.rand(1, 25, 9, 7, generator=generator)
    rows, cols = (torch.from_numpy(select_axis(1, 3).present), torch.from_numpy(select_axis(0, 4).present))
    other = around.clone().reshape(1, SIDE, SIDE, 9, 7)
    other[:, [3, 4]] = 0.7
    other[:, :, 4] = 0.1
    assert torch.equal(network(image, around, rows, cols), network(image, other.reshape(1, 25, 9, 7), rows, cols))
    other[:, 2, 3] = 0.1
    assert not torch.equal(network(image, around, rows, cols), network(image, other.reshape(1, 25, 9, 7), rows, cols))


@pytest.mark.parametrize("guard", [False, True])
def test_a_merged_network_computes_the_same(guard):
    torch.manual_seed(0)
    network = LightFieldGenerator((8, 8), width=8, depth=1, guard=guard)
    plain = collapse(network)
    fold_factors(plain)
    merge_layers(plain)
    generator = torch.Generator().manual_seed(4)
    image, around = torch.rand(1, 3, 9, 7, generator=generator), torch.rand(1, 25, 9, 7, generator=generator)
    there = torch.from_numpy(select_axis(2, 5).present)
    torch.testing.assert_close(
        plain(image, around, there, there), network(image, around, there, there), atol=1e-5, rtol=0
    )
    assert plain.merged is not None
    assert plain.factors == (1.0, 1.0)
