import pytest

from tests.support.paths import SHARED

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.data import degrade
from ciir.training.data.pictures import read_rgb

SET5 = SHARED / "data" / "images" / "Set5"


def ramp(length: int) -> torch.Tensor:
    """`(1, 1, length, length)`, four 8-bit levels from one column to the next."""
    return (torch.arange(length).float() * 4 / 255).expand(1, 1, length, length)


@pytest.mark.parametrize("scale", [2, 3, 4])
def test_low_sample_i_lies_in_the_middle_of_its_high_samples(scale):
    """A ramp keeps its value at the sample centres, so that half a pixel off is off by two levels and more."""
    high = ramp(12 * scale)
    want = (torch.arange(12) * scale + (scale - 1) / 2) * 4
    for image in (high, high.transpose(2, 3)):
        low = degrade.bicubic(image, scale)[0, 0] * 255
        low = low if image is high else low.T
        assert (low - want).abs()[:, 2:-2].max() <= 0.5 + 1e-3


@pytest.mark.skipif(not SET5.is_dir(), reason="needs ../shared")
@pytest.mark.parametrize("name", ["001", "002", "003", "004", "005"])
def test_against_the_published_low_resolution(name):
    """MATLAB's own LR pictures, inside the border: off by a level here and there, in neither direction."""
    high = degrade.to_tensor(torch.from_numpy(read_rgb(SET5 / f"img_{name}_SRF_2_HR.png")))
    published = degrade.to_tensor(torch.from_numpy(read_rgb(SET5 / f"img_{name}_SRF_2_LR.png")))
    inside = (..., slice(2, -2), slice(2, -2))
    difference = (degrade.bicubic(high, 2) - published)[inside] * 255
    assert difference.abs().max() <= 2.01
    assert difference.abs().mean() <= 0.2
    assert difference.mean().abs() <= 0.02


def test_a_size_that_the_scale_does_not_divide():
    with pytest.raises(ValueError, match=r"7x8.*scale 2.*crop"):
        degrade.bicubic(torch.zeros(1, 3, 7, 8), 2)
    assert degrade.crop_to_multiple(torch.zeros(1, 3, 7, 8), 3).shape == (1, 3, 6, 6)


def test_box_and_point_lie_on_the_same_grid_as_bicubic():
    high = ramp(24)
    want = (torch.arange(12) * 2 + 0.5) * 4
    for degraded in (degrade.box(high, 2), degrade.point(high, 2)):
        assert (degraded[0, 0] * 255 - want).abs().max() <= 0.5 + 1e-3


def test_a_point_is_the_middle_of_its_cell():
    cell = torch.arange(16).reshape(1, 1, 4, 4).repeat(1, 1, 2, 3) / 255
    assert (degrade.point(cell, 4) * 255 == round((5 + 6 + 9 + 10) / 4)).all()
    assert (degrade.point(torch.arange(9).reshape(1, 1, 3, 3) / 255, 3) * 255).item() == 4
    assert (degrade.box(cell, 4) * 255).unique().item() == 8  # 7.5, to even


def test_a_point_is_smaller_than_a_pixel_of_the_truth():
    """Otherwise it would be the box: here it differs from it where the photograph is rough."""
    rough = torch.randint(0, 256, (3, 40, 44), generator=torch.Generator().manual_seed(2), dtype=torch.uint8)
    low, high = degrade.make_pair("point", rough, 2)
    assert (low.shape, high.shape) == ((3, 10, 11), (3, 20, 22))
    middle = rough.reshape(3, 10, 4, 11, 4)[:, :, 1:3, :, 1:3].float().mean((2, 4))
    assert (low - middle).abs().max() <= 0.5


@pytest.mark.parametrize(("kind", "scale", "covered"), [("bicubic", 4, 4), ("box", 3, 3), ("point", 4, 8)])
def test_a_pair_is_cut_to_whole_cells(kind, scale, covered):
    low, high = degrade.make_pair(kind, torch.full((1, 3 * covered + 1, 2 * covered + 2), 77, dtype=torch.uint8), scale)
    assert (low.shape, high.shape) == ((1, 3, 2), (1, 3 * scale, 2 * scale))
    assert (low == 77).all()
    assert (high == 77).all()
