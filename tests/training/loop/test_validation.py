import numpy as np
import pytest
from PIL import Image

torch = pytest.importorskip("torch", reason="needs the training extra")

from ciir.training.evaluation.metrics import compute_psnr, rgb_to_luma
from ciir.training.loop import validation


class Repeat(torch.nn.Module):
    """Nearest-neighbour x2, with a weight as every network has one."""

    def __init__(self):
        super().__init__()
        self.gain = torch.nn.Parameter(torch.ones(()))

    def forward(self, image):
        return self.gain * torch.nn.functional.interpolate(image, scale_factor=2.0, mode="nearest")


@pytest.fixture
def picture():
    return np.random.default_rng(0).integers(0, 256, (13, 18, 3), np.uint8)


def save(pixels, path):
    Image.fromarray(pixels).save(path)


def test_pairs_and_their_score(picture, tmp_path):
    high = np.repeat(np.repeat(picture, 2, 0), 2, 1)
    noisy = np.clip(high.astype(int) + 3, 0, 255).astype(np.uint8)
    for name, truth in (("a", high), ("b", noisy)):
        save(truth, tmp_path / f"{name}_HR.png")
        save(picture, tmp_path / f"{name}_LR.png")
    save(picture, tmp_path / "other.png")
    pairs = validation.read_pairs(tmp_path, 2)
    assert len(pairs) == 2
    network = Repeat()
    assert (
        validation.validate_network(network, pairs[:1], 2) > 300
    )  # equal, up to the rounding of two ways to sum three products
    want = compute_psnr(rgb_to_luma(high), rgb_to_luma(noisy), border=2)
    assert validation.validate_network(network, pairs[1:], 2) == pytest.approx(want, abs=1e-9)
    assert network.training


def test_pictures_of_12_bits_fill_the_range(picture, tmp_path):
    grey = picture[:12, :, 0].repeat(2, axis=0).repeat(2, axis=1)
    for folder, names in (("pairs", ("a_HR.png", "a_LR.png")), ("pictures", ("a.png",))):
        (tmp_path / folder).mkdir()
        for name, pixels in zip(names, (grey, picture[:12, :, 0]), strict=False):
            save(pixels.astype(np.uint16) * 16, tmp_path / folder / name)
        ((_, high),) = validation.read_pairs(tmp_path / folder, 2)
        assert np.abs(high.astype(int) - grey[..., np.newaxis]).max() <= 1


def test_a_folder_of_pictures_is_downscaled_bicubically(picture, tmp_path):
    save(picture, tmp_path / "a.png")
    save(np.full((12, 12), 99, np.uint8), tmp_path / "grey.tif")
    (low, high), (grey, _) = validation.read_pairs(tmp_path, 2)
    assert (low.shape, high.shape) == ((6, 9, 3), (12, 18, 3))
    assert np.array_equal(high, picture[:12])
    assert (grey == 99).all()


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, "no picture in it"),
        ({"a_LR.png": (8, 8)}, r"a_HR\.png: missing"),
        ({"a_LR.png": (8, 8), "a_HR.png": (16, 20)}, r"a_HR\.png: 16x20 pixels, but its LR is 8x8.*at scale 2"),
        ({"a.png": (5, 40)}, "too small to validate on"),
    ],
)
def test_unusable_folders(tmp_path, files, message):
    for name, size in files.items():
        save(np.zeros((*size, 3), np.uint8), tmp_path / name)
    with pytest.raises(ValueError, match=message):
        validation.read_pairs(tmp_path, 2)
