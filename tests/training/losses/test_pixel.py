import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.losses import pixel

OUTPUT = torch.tensor([0.5, 0.25, 0.0, 1.0])
HIGH = torch.tensor([0.5, 0.75, 0.25, 0.0])


def test_l1():
    assert pixel.l1(OUTPUT, HIGH).item() == (0.5 + 0.25 + 1.0) / 4


def test_mse():
    assert pixel.mse(OUTPUT, HIGH).item() == (0.25 + 0.0625 + 1.0) / 4


def test_names():
    assert pixel.find_pixel_loss("mse") is pixel.mse
    with pytest.raises(ValueError, match="loss: 'l2' is not known; give one of l1, mse, luma, squared-luma"):
        pixel.find_pixel_loss("l2")


def test_weights_of_luma():
    """A grey difference counts whole; a blue one by its third of RGB and its 0.114 of Y."""
    black = torch.zeros(1, 3, 4, 5)
    assert pixel.luma(black + 0.2, black).item() == pytest.approx(0.2)
    blue = black.clone()
    blue[:, 2] = 0.2
    assert pixel.luma(blue, black).item() == pytest.approx(0.2 * (0.3 / 3 + 0.7 * 0.114))


def test_squares_of_luma():
    black = torch.zeros(1, 3, 4, 5)
    expected = 0.2 + pixel.SQUARES * 0.2**2
    assert pixel.squared_luma(black + 0.2, black).item() == pytest.approx(expected)
