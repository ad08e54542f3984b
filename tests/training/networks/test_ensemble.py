"""An ensemble that begins as one generator is the mean of what that makes of turned pictures."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from torch.nn import functional

from ciir.training.networks import make_network
from ciir.training.networks.collapsible import CollapsibleConv, collapse
from ciir.training.networks.compact import CompactGenerator
from ciir.training.networks.ensemble import ROUNDING, Ensemble, split_weights
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


def make_brighter(amount):
    """An ensemble whose picture is brighter by `amount` than interpolation."""
    ensemble = Ensemble((8, 8), projected=True)
    for weight in (weight for member in ensemble.members for weight in member.tail.parameters()):
        weight.zero_()
    ensemble.members[0].tail.bias.add_(amount)
    return ensemble


@torch.no_grad()
@pytest.mark.parametrize("levels", [0.1, 1.0, 4.0])
def test_back_projection_takes_up_small_differences_whole_and_leaves_large_ones(levels):
    image = torch.full((1, 3, 9, 9), 0.5)
    amount = levels / 255
    reduced = BicubicReduction(2)(functional.pixel_unshuffle(make_brighter(amount)(image), 2))
    left = amount - amount / (1 + (amount / ROUNDING) ** 4)  # 1e-4, a half, and 0.996 of it
    torch.testing.assert_close(reduced - image, torch.full_like(image, left), atol=1e-6, rtol=0)


@torch.no_grad()
def test_back_projection_weighs_by_neighbourhoods():
    """A difference of a hundredth of a level is taken up, but not beside an edge that was not made bicubically."""
    ensemble, image = make_brighter(0.01 / 255), torch.full((1, 3, 24, 24), 0.5)
    plain = make_brighter(0.01 / 255)
    plain.reduction = None
    image[..., 12] = torch.tensor([0.9, 0.1]).repeat(12)  # alternating samples, which no reduction leaves
    change = (ensemble(image) - plain(image)).abs()
    assert change[..., 2:-2, 2:12].max() > 0.009 / 255
    assert change[..., 2:-2, 20:28].max() < 0.3 / 255


def test_back_projection_is_trained_through():
    torch.manual_seed(10)
    ensemble = Ensemble((8, 8), projected=True)
    ensemble(torch.rand(1, 3, 9, 9)).square().mean().backward()
    assert all(member.tail.kernel.grad.abs().max() > 0 for member in ensemble.members)
    assert all(weight.grad is None for weight in ensemble.reduction.parameters())


def test_options_are_those_of_each_member():
    ensemble = make_network("ensemble", {"widths": [8, 8], "members": 3, "rounded": True})
    rounded = [layer for layer in ensemble.modules() if isinstance(layer, RoundedReLU)]
    assert len(rounded) == 6
    leaky = make_network("ensemble", {"widths": [8, 8], "slope": 0.125})
    assert {layer.negative_slope for layer in leaky.modules() if isinstance(layer, torch.nn.LeakyReLU)} == {0.125}
    with pytest.raises(ValueError, match="members is 0; give 1 or more"):
        make_network("ensemble", {"widths": [8, 8], "members": 0})
