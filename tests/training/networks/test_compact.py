import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from torch import nn
from torch.nn import functional

from ciir.models.single.interpolation import Bicubic
from ciir.training.networks.collapsible import CollapsibleConv, collapse
from ciir.training.networks.compact import CompactGenerator


def trained(module: nn.Module, seed: int) -> nn.Module:
    """All weights away from the values that they start with."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for weight in module.parameters():
            if weight.requires_grad:
                weight.add_(0.1 * torch.randn(weight.shape, generator=generator))
    return module


def branches(layer: CollapsibleConv, x: torch.Tensor) -> torch.Tensor:
    """The sum of the branches of `CollapsibleConv`."""
    total = functional.conv2d(x, layer.kernel, layer.bias, padding=1)
    total = total + functional.conv2d(functional.conv2d(x, layer.widen, padding=1), layer.narrow[..., None, None])
    total = total + functional.conv2d(x, layer.point[..., None, None])
    return total + x if layer.identity else total


@pytest.mark.parametrize(("inputs", "outputs"), [(3, 8), (8, 8), (8, 12)])
@pytest.mark.parametrize("size", [(1, 1), (7, 5)])
def test_the_kernel_is_the_sum_of_the_branches(inputs, outputs, size):
    """In float64, borders too: only the order of additions differs."""
    layer = trained(CollapsibleConv(inputs, outputs), 0).double()
    x = torch.rand(2, inputs, *size, dtype=torch.float64)
    want = branches(layer, x)
    assert (layer(x) - want).abs().max() <= 1e-12
    assert (layer.collapsed().double()(x) - want).abs().max() <= 1e-5  # its weights are float32


def test_a_collapsed_network_is_plain_and_the_same():
    network = trained(CompactGenerator((8, 8)), 1)
    plain = collapse(network)
    assert not any(isinstance(module, CollapsibleConv) for module in plain.modules())
    assert any(isinstance(module, CollapsibleConv) for module in network.modules())
    image = torch.rand(2, 3, 9, 13)
    assert torch.equal(plain(image), network(image))


@pytest.mark.parametrize("scale", [2, 4])
def test_the_base_is_bicubic_interpolation(scale):
    """Ours in models/, whose border repeats the outermost pixels too."""
    network = CompactGenerator((4,), scale=scale)
    with torch.no_grad():
        for weight in network.tail.parameters():
            weight.zero_()
    image = torch.rand(1, 3, 6, 9, generator=torch.Generator().manual_seed(3))
    got = network(image).detach().clamp(0, 1).numpy()
    assert abs(got - Bicubic(scale)(image.numpy())).max() <= 1e-5
