"""An ensemble that begins as one generator is the mean of what that makes of turned pictures."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.networks.collapsible import CollapsibleConv, collapse
from ciir.training.networks.compact import CompactGenerator
from ciir.training.networks.ensemble import Ensemble, split_weights


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


def test_each_member_is_trained_and_the_limit_is_of_the_sum():
    torch.manual_seed(6)
    ensemble = Ensemble((8, 8), guard=True)
    image = torch.rand(1, 3, 9, 9)
    ensemble(image).square().mean().backward()
    layers = [layer for layer in ensemble.modules() if isinstance(layer, CollapsibleConv)]
    assert len(layers) == 6
    assert all(layer.kernel.grad.abs().max() > 0 for layer in layers)
    flat = torch.full((1, 3, 9, 9), 0.3)
    torch.testing.assert_close(ensemble(flat), torch.full((1, 3, 18, 18), 0.3), atol=1e-6, rtol=0)
