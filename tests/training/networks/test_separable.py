import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.networks.interpolation import Bicubic
from ciir.training.networks.separable import SeparableBicubic


@pytest.mark.parametrize(("scale", "colours"), [(2, 3), (4, 3), (3, 1)])
def test_it_is_the_same_interpolation(scale, colours):
    base = Bicubic(scale, colours)
    image = torch.rand(2, colours, 7, 9)
    torch.testing.assert_close(SeparableBicubic(base)(image), base(image), atol=1e-6, rtol=0)
