"""Rounding during training: close to what the int8 export computes, no effect outside of training, gradients pass."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.networks import make_network
from ciir.training.networks.rounding import round_activations, round_weights

OPTIONS = {"widths": [16, 16, 16], "slope": 0.0, "guard": True}


def make(**options):
    torch.manual_seed(3)
    return make_network("compact", OPTIONS | options)


def test_only_training_is_rounded():
    image = torch.rand(2, 3, 9, 11)
    plain, rounded = make(), make(rounded=True)
    assert plain.state_dict().keys() == rounded.state_dict().keys()
    assert not torch.equal(rounded(image), plain(image))
    torch.testing.assert_close(rounded(image), plain(image), atol=0.05, rtol=0)
    assert torch.equal(rounded.eval()(image), plain.eval()(image))


def test_levels():
    x = torch.linspace(0, 2, 1001)
    made = round_activations(x)
    assert len(made.unique()) == 256
    assert made.max() == pytest.approx(2)
    assert (made - x).abs().max() <= 1 / 255 * 1.001
    assert (round_activations(torch.zeros(3)) == 0).all()
    weight = torch.randn(4, 3, 3, 3) * torch.tensor([1.0, 10, 0.1, 0])[:, None, None, None]
    largest = weight.abs().amax((1, 2, 3))
    assert ((round_weights(weight) - weight).abs().amax((1, 2, 3)) <= largest / 254 * 1.001).all()


def test_gradients_pass():
    for round_values in (round_activations, round_weights):
        values = torch.rand(4, 3, 3, 3, requires_grad=True)
        round_values(values).sum().backward()
        assert (values.grad == 1).all()


def test_slopes_are_refused():
    with pytest.raises(ValueError, match="rounded: activations are rounded behind ReLUs; set slope = 0"):
        make(rounded=True, slope=0.1)
