import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from torch import nn

from ciir.training.networks.discriminator import Discriminator


def rand(*shape):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(0))


def test_it_is_srgans():
    """Ledig et al. 2017, figure 4: k3 n64 s1, n64 s2, n128 s1 ... n512 s2, batch normalisation but for the first."""
    with torch.device("meta"):
        network = Discriminator()
    convolutions = [m for m in network.modules() if isinstance(m, nn.Conv2d)]
    assert [m.out_channels for m in convolutions] == [64, 64, 128, 128, 256, 256, 512, 512]
    assert [m.stride[0] for m in convolutions] == [1, 2] * 4
    assert sum(isinstance(m, nn.BatchNorm2d) for m in network.modules()) == 7
    assert {m.negative_slope for m in network.modules() if isinstance(m, nn.LeakyReLU)} == {0.2}
    assert [m.out_features for m in network.modules() if isinstance(m, nn.Linear)] == [1024, 1]


@pytest.mark.parametrize("size", [(16, 16), (25, 17), (88, 88)])
def test_one_logit_for_each_picture_of_any_size(size):
    network = Discriminator((4, 8))
    image = rand(3, 3, *size)
    features = network.features(image)
    height, width = size
    halves = ((height + 1) // 2, (width + 1) // 2)
    quarters = ((halves[0] + 1) // 2, (halves[1] + 1) // 2)
    assert [tuple(f.shape[1:]) for f in features] == [(4, *size), (4, *halves), (8, *halves), (8, *quarters)]
    logits = network(image)
    assert logits.shape == (3,)
    assert torch.equal(logits, network.logits(features))
    assert logits.min() < 0 or logits.max() > 1 or logits.std() > 0  # no sigmoid at its end would leave them so


def test_without_normalisation_a_logit_does_not_depend_on_the_batch():
    network = Discriminator((4, 8), normalise=False)
    image = rand(3, 3, 20, 20)
    assert (network(image)[:1] - network(image[:1])).abs().max() <= 1e-6  # float32, sums in another order
    assert not list(network.buffers())
    assert not [m for m in network.modules() if isinstance(m, nn.BatchNorm2d)]
