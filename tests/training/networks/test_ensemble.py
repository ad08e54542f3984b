"""An ensemble that begins as one generator is the mean of what that makes of turned pictures."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import numpy as np
import torch
from torch.nn import functional

from ciir.training.networks import ensemble as module
from ciir.training.networks import make_network
from ciir.training.networks.collapsible import CollapsibleConv, collapse
from ciir.training.networks.compact import CompactGenerator
from ciir.training.networks.ensemble import Ensemble, split_weights
from ciir.training.networks.guard import limit_change
from ciir.training.networks.interpolation import BicubicReduction
from ciir.training.networks.rounding import RoundedReLU


@pytest.mark.parametrize("members", [1, 2, 3, 4])
@pytest.mark.parametrize("scale", [2, 4])
@torch.no_grad()
def test_it_begins_as_the_mean_over_turns(members, scale):
    torch.manual_seed(5)
    generator = CompactGenerator((8, 12), scale, 0.0)
    for weight in generator.parameters():
        if weight.requires_grad:
            weight.add_(0.05 * torch.randn_like(weight))
    plain = {name: weight for name, weight in collapse(generator).state_dict().items() if not name.startswith("base.")}
    ensemble = collapse(Ensemble((8, 12), scale, members=members))
    missing, unknown = ensemble.load_state_dict(split_weights(plain, members), strict=False)
    assert not unknown
    assert all(".base." in name for name in missing)
    image = torch.rand(2, 3, 7, 10)
    turned = [generator(image.rot90(k, (2, 3))).rot90(-k, (2, 3)) for k in range(members)]
    torch.testing.assert_close(ensemble(image), torch.stack(turned).mean(0), atol=1e-5, rtol=0)  # orders of sums
    if members > 1:
        assert (turned[0] - turned[1]).abs().max() > 0.01


def test_each_member_is_trained():
    torch.manual_seed(6)
    ensemble = Ensemble((8, 8), guard=True)
    ensemble(torch.rand(1, 3, 9, 9)).square().mean().backward()
    layers = [layer for layer in ensemble.modules() if isinstance(layer, CollapsibleConv)]
    assert len(layers) == 6
    assert all(layer.kernel.grad.abs().max() > 0 for layer in layers)


@torch.no_grad()
def test_the_limit_is_that_of_the_sum():
    torch.manual_seed(7)
    ensemble = Ensemble((8, 8), guard=True)
    for member in ensemble.members:
        member.tail.kernel.mul_(30)  # far beyond the limit
    image = torch.rand(1, 3, 9, 9)
    changes = [member.compute_change(image) for member in ensemble.members]
    base = ensemble.members[0].base(image)
    wanted = functional.pixel_shuffle(limit_change(changes[0] + changes[1], image) + base, 2)
    torch.testing.assert_close(ensemble(image), wanted, atol=1e-5, rtol=0)
    each = functional.pixel_shuffle(sum(limit_change(change, image) for change in changes) + base, 2)
    assert (each - wanted).abs().max() > 0.01


def make_brighter(amount, scale=2, **options):
    """An ensemble whose picture is brighter by `amount` than interpolation."""
    ensemble = Ensemble((8, 8), scale, projected=True, **options)
    for weight in (weight for member in ensemble.members for weight in member.tail.parameters()):
        weight.zero_()
    ensemble.members[0].tail.bias.add_(amount)
    return ensemble


@torch.no_grad()
@pytest.mark.parametrize("scale", [2, 4])
@pytest.mark.parametrize("levels", [0.1, 1.0, 4.0])
def test_back_projection_takes_up_small_differences_and_leaves_large_ones(levels, scale):
    image = torch.full((1, 3, 9, 9), 0.5)
    amount = levels / 255
    reduced = BicubicReduction(scale)(functional.pixel_unshuffle(make_brighter(amount, scale)(image), scale))
    left = amount - amount / (1 + levels**4)  # 1e-4, a half, and 0.996 of it
    torch.testing.assert_close(reduced - image, torch.full_like(image, left), atol=1e-6, rtol=0)


@torch.no_grad()
def test_weights_of_back_projection_are_those_of_a_plain_computation():
    difference = torch.randn(2, 3, 8, 9, generator=torch.Generator().manual_seed(11)) * 3 / 255
    wanted = torch.empty_like(difference)
    for number, row, col in np.ndindex(2, 8, 9):
        around = difference[number, :, max(0, row - 2) : row + 3, max(0, col - 2) : col + 3]
        power = float((255 * around).square().mean())
        wanted[number, :, row, col] = difference[number, :, row, col] / (1 + power**2)
    torch.testing.assert_close(module._weigh(difference), wanted, atol=1e-7, rtol=1e-5)


@torch.no_grad()
def test_the_limit_holds_for_back_projection_too():
    """A flat part stays as it is, whatever lies beside it."""
    image = torch.full((1, 3, 12, 24), 0.5)
    image[..., :8] += 0.05 * torch.rand(12, 8, generator=torch.Generator().manual_seed(12))
    made = make_brighter(0.5 / 255, guard=True)(image)
    flat = slice(20, 44)  # from two pixels behind the texture on
    torch.testing.assert_close(made[..., flat], torch.full_like(made[..., flat], 0.5), atol=1e-6, rtol=0)
    assert (make_brighter(0.5 / 255)(image)[..., flat] - 0.5).abs().max() > 0.03 / 255


def test_back_projection_is_trained_through():
    network = Ensemble((8, 8), projected=True).double()
    image = torch.rand(1, 3, 9, 9, generator=torch.Generator().manual_seed(13), dtype=torch.float64)
    bias = network.members[1].tail.bias

    def score():
        return network(image).square().mean()

    score().backward()
    step = 1e-6
    with torch.no_grad():
        bias[5] += step
        above = score()
        bias[5] -= 2 * step
        below = score()
    assert float(bias.grad[5]) == pytest.approx(float(above - below) / (2 * step), rel=1e-5)
    assert all(weight.grad is None for weight in network.reduction.parameters())


def test_options_are_those_of_each_member():
    ensemble = make_network("ensemble", {"widths": [8, 8], "members": 3, "rounded": True})
    rounded = [layer for layer in ensemble.modules() if isinstance(layer, RoundedReLU)]
    assert len(rounded) == 6
    leaky = make_network("ensemble", {"widths": [8, 8], "slope": 0.125})
    assert {layer.negative_slope for layer in leaky.modules() if isinstance(layer, torch.nn.LeakyReLU)} == {0.125}
    with pytest.raises(ValueError, match="members is 0; give 1 or more"):
        make_network("ensemble", {"widths": [8, 8], "members": 0})
