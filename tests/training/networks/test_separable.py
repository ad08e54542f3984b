import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.networks import make_network
from ciir.training.networks.interpolation import Bicubic
from ciir.training.networks.separable import SeparableBicubic, separate


@pytest.mark.parametrize(("scale", "colours"), [(2, 3), (4, 3), (3, 1)])
def test_it_is_the_same_interpolation(scale, colours):
    base = Bicubic(scale, colours)
    image = torch.rand(2, colours, 7, 9)
    torch.testing.assert_close(SeparableBicubic(base)(image), base(image), atol=1e-6, rtol=0)


def test_a_network_stays_the_same_and_its_copy_is_changed():
    network = make_network("compact", {"widths": [8]}).eval()
    changed = separate(network)
    assert isinstance(network.base, Bicubic)
    assert isinstance(changed.base, SeparableBicubic)
    image = torch.rand(1, 3, 8, 5)
    torch.testing.assert_close(changed(image), network(image), atol=1e-6, rtol=0)
