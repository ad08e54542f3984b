import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.networks.interpolation import Bicubic, SeparableBicubic


@pytest.mark.parametrize(("scale", "colours"), [(2, 3), (4, 3), (3, 1)])
def test_it_is_the_same_interpolation(scale, colours):
    base = Bicubic(scale, colours)
    image = torch.rand(2, colours, 7, 9, generator=torch.Generator().manual_seed(0))
    # Sums of up to 25 products in float32, in another order: up to 1.2e-6 in 400 pictures.
    torch.testing.assert_close(SeparableBicubic(base)(image), base(image), atol=2e-6, rtol=0)
