import pytest

pytest.importorskip("torch", reason="needs the training extra")
import numpy as np
import torch
from PIL import Image
from torch.nn import functional

from ciir.training.networks.interpolation import Bicubic, BicubicReduction, SeparableBicubic


@pytest.mark.parametrize(("scale", "colours"), [(2, 3), (4, 3), (3, 1)])
def test_it_is_the_same_interpolation(scale, colours):
    base = Bicubic(scale, colours)
    image = torch.rand(2, colours, 7, 9, generator=torch.Generator().manual_seed(0))
    # Sums of up to 25 products in float32, in another order: up to 1.2e-6 in 400 pictures.
    torch.testing.assert_close(SeparableBicubic(base)(image), base(image), atol=2e-6, rtol=0)


@pytest.mark.parametrize("scale", [2, 3, 4])
def test_reduction_is_that_of_pillow(scale):
    large = torch.rand(2, 3, 9 * scale, 11 * scale, generator=torch.Generator().manual_seed(1))
    made = BicubicReduction(scale)(functional.pixel_unshuffle(large, scale))
    assert made.shape == (2, 3, 9, 11)
    for picture, reduced in zip(large.flatten(0, 1), made.flatten(0, 1), strict=True):
        wanted = np.asarray(Image.fromarray(picture.numpy()).resize((11, 9), Image.Resampling.BICUBIC))
        # Pillow leaves out what lies beyond the border; both sum in float32.
        np.testing.assert_allclose(reduced.numpy()[2:-2, 2:-2], wanted[2:-2, 2:-2], atol=1e-6)


def test_reduction_keeps_a_flat_picture():
    flat = torch.tensor([0.2, 0.5, 0.9])[None, :, None, None].expand(1, 3, 4, 5)
    made = BicubicReduction(2)(flat.repeat_interleave(4, dim=1))
    torch.testing.assert_close(made, flat, atol=1e-6, rtol=0)


def test_at_the_border_the_outermost_pixels_are_repeated_with_their_phases():
    phases = torch.rand(1, 12, 5, 6, generator=torch.Generator().manual_seed(2))
    rows, cols = torch.tensor([0, 0, 0, 1, 2, 3, 4, 4, 4]), torch.tensor([0, 0, 0, 1, 2, 3, 4, 5, 5, 5])
    wider = phases[:, :, rows][..., cols]
    reduction = BicubicReduction(2)
    torch.testing.assert_close(reduction(phases), reduction(wider)[..., 2:-2, 2:-2], atol=1e-6, rtol=0)
