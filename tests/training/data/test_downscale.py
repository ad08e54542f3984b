import numpy as np
import pytest

from ciir.training.data.downscale import KINDS, cell_size, downscale_picture
from ciir.training.data.pictures import read_rgb
from tests.support.paths import SHARED

SET5 = SHARED / "data" / "images" / "Set5"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scale", [2, 3, 4])
def test_a_ramp_keeps_its_values_at_the_sample_centres(kind, scale):
    """Four levels from one pixel to the next: half a pixel off is two levels off."""
    side = 12 * cell_size(kind, scale)
    ramp = np.broadcast_to((np.arange(side) * 240 // side).astype(np.uint8)[:, None], (side, side, 3))[..., :1]
    for picture in (ramp, ramp.swapaxes(0, 1)):
        low, high = downscale_picture(kind, picture, scale)
        assert (low.shape[0] * scale, low.shape[1] * scale) == high.shape[:2]
        cells = high.astype(float).reshape(12, scale, 12, scale).mean((1, 3))
        assert np.abs(low[2:-2, 2:-2, 0] - cells[2:-2, 2:-2]).max() <= 1


@pytest.mark.parametrize("kind", ["bicubic", "box"])
@pytest.mark.parametrize("scale", [2, 3, 4])
def test_torch_computes_the_same(kind, scale):
    torch = pytest.importorskip("torch", reason="needs the training extra")
    from tests.training import degradations

    picture = np.random.default_rng(scale).integers(0, 256, (83, 102, 3), np.uint8)
    low, high = downscale_picture(kind, picture, scale)
    np.testing.assert_array_equal(high, picture[: len(high), : high.shape[1]])
    image = torch.from_numpy(high).permute(2, 0, 1)[None].float().div(255)
    made = getattr(degradations, kind)(image, scale)[0].permute(1, 2, 0).mul(255).round().numpy()
    difference = np.abs(low - made)
    assert difference.max() <= (kind == "bicubic")  # exact halves are rounded by chance in torch's float32
    assert (difference > 0).mean() < 1e-3


@pytest.mark.skipif(not SET5.is_dir(), reason="needs ../shared")
@pytest.mark.parametrize("name", ["001", "002", "003", "004", "005"])
def test_against_the_published_low_resolution(name):
    """MATLAB's own LR pictures, inside the border: off by a level here and there, in neither direction."""
    published = read_rgb(SET5 / f"img_{name}_SRF_2_LR.png").astype(int)
    low, _ = downscale_picture("bicubic", read_rgb(SET5 / f"img_{name}_SRF_2_HR.png"), 2)
    difference = (low - published)[2:-2, 2:-2]
    assert np.abs(difference).max() <= 2
    assert np.abs(difference).mean() <= 0.2
    assert np.abs(difference.mean()) <= 0.02


def test_a_point_is_the_middle_of_its_cell():
    """And so smaller than a pixel of the truth, the mean of a quarter of the cell."""
    rough = np.random.default_rng(2).integers(0, 256, (40, 44, 3), np.uint8)
    low, high = downscale_picture("point", rough, 2)
    assert (low.shape, high.shape) == ((10, 11, 3), (20, 22, 3))
    middle = rough.reshape(10, 4, 11, 4, 3)[:, 1:3, :, 1:3].mean((1, 3))
    assert np.abs(low - middle).max() <= 0.5


@pytest.mark.parametrize(("kind", "scale", "covered"), [("bicubic", 4, 4), ("box", 3, 3), ("point", 4, 8)])
def test_a_pair_is_cut_to_whole_cells(kind, scale, covered):
    low, high = downscale_picture(kind, np.full((3 * covered + 1, 2 * covered + 2, 1), 77, np.uint8), scale)
    assert (low.shape, high.shape) == ((3, 2, 1), (3 * scale, 2 * scale, 1))
    assert (low == 77).all()
    assert (high == 77).all()


def test_errors():
    with pytest.raises(ValueError, match="no 'lanczos' here; give one of bicubic, box, point"):
        downscale_picture("lanczos", np.zeros((8, 8, 3), np.uint8), 2)
    with pytest.raises(ValueError, match="3x9 is smaller than the 4x4 of one LR pixel"):
        downscale_picture("point", np.zeros((3, 9, 1), np.uint8), 2)
