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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scale", [2, 3, 4])
def test_torch_computes_the_same(kind, scale):
    torch = pytest.importorskip("torch", reason="needs the training extra")
    from ciir.training.data import degrade

    picture = np.random.default_rng(scale).integers(0, 256, (83, 102, 3), np.uint8)
    low, high = downscale_picture(kind, picture, scale)
    crops = [
        part.permute(1, 2, 0).numpy()
        for part in degrade.make_pair(kind, torch.from_numpy(picture).permute(2, 0, 1), scale)
    ]
    np.testing.assert_array_equal(high, crops[1])
    difference = np.abs(low.astype(int) - crops[0])
    assert difference.max() <= (kind == "bicubic")  # exact halves are rounded by chance in torch's float32
    assert (difference > 0).mean() < 1e-3


@pytest.mark.skipif(not SET5.is_dir(), reason="needs ../shared")
def test_against_the_published_low_resolution():
    published = read_rgb(SET5 / "img_001_SRF_2_LR.png").astype(int)
    low, _ = downscale_picture("bicubic", read_rgb(SET5 / "img_001_SRF_2_HR.png"), 2)
    difference = (low - published)[2:-2, 2:-2]
    assert np.abs(difference).max() <= 2
    assert np.abs(difference).mean() <= 0.2


def test_errors():
    with pytest.raises(ValueError, match="no 'lanczos' here; give one of bicubic, box, point"):
        downscale_picture("lanczos", np.zeros((8, 8, 3), np.uint8), 2)
    with pytest.raises(ValueError, match="3x9 is smaller than the 4x4 of one LR pixel"):
        downscale_picture("point", np.zeros((3, 9, 1), np.uint8), 2)
