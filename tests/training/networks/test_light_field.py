"""The light-field generator."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.models.light_field.planes import Range, describe_window
from ciir.models.light_field.windows import WINDOW_SIDE, select_axis
from ciir.training.networks.collapsible import collapse
from ciir.training.networks.light_field import LightFieldGenerator, fold_factors, merge_layers

PLANES = 6


def make_network(**options):
    torch.manual_seed(0)
    return LightFieldGenerator((8, 8), width=8, depth=1, planes=PLANES, **options)


def draw_inputs(rows, cols):
    """A random view and window, and what describes the window."""
    generator = torch.Generator().manual_seed(3)
    image, around = torch.rand(1, 3, 9, 7, generator=generator), torch.rand(1, 25, 9, 7, generator=generator)
    window = describe_window(select_axis(*rows), select_axis(*cols), Range(-0.5, 1.0), PLANES)
    return image, around, [torch.from_numpy(part.copy()) for part in window]


def test_missing_views_are_ignored():
    network = make_network()
    image, around, window = draw_inputs((1, 3), (0, 4))
    other = around.clone().reshape(1, WINDOW_SIDE, WINDOW_SIDE, 9, 7)
    other[:, [3, 4]] = 0.7
    other[:, :, 4] = 0.1
    assert torch.equal(network(image, around, *window), network(image, other.flatten(1, 2), *window))
    other[:, 2, 3] = 0.1
    assert not torch.equal(network(image, around, *window), network(image, other.flatten(1, 2), *window))


def test_the_result_depends_on_the_range_of_disparities():
    network = make_network()
    image, around, (down, across, window) = draw_inputs((2, 5), (2, 5))
    wider = torch.cat([window[:4], window[4:] * 2])
    one, same, other = (network(image, around, down, across, each) for each in (window, window, wider))
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


@pytest.mark.parametrize("guard", [False, True])
def test_a_merged_network_computes_the_same(guard):
    network = make_network(guard=guard)
    plain = collapse(network)
    fold_factors(plain)
    merge_layers(plain)
    image, around, window = draw_inputs((2, 5), (2, 5))
    torch.testing.assert_close(plain(image, around, *window), network(image, around, *window), atol=1e-5, rtol=0)
    assert plain.merged is not None
    assert plain.factors == (1.0, 1.0)
