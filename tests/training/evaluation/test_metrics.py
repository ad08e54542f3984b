import numpy as np
import pytest

from ciir.training.evaluation.metrics import average, compute_psnr, compute_ssim, rgb_to_luma, score_map

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")


def planes() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(5)
    y, x = np.mgrid[:37, :52]
    truth = 128 + 80 * np.sin(x / 5) * np.cos(y / 7)
    return (truth + random.normal(0, 9, truth.shape)).clip(0, 255), truth


def test_luma_of_black_white_and_green():
    picture = np.array([[[0, 0, 0], [255, 255, 255], [0, 255, 0]]], np.uint8)
    np.testing.assert_allclose(rgb_to_luma(picture), [[16.0, 235.0, 144.553]])


def test_psnr_of_a_known_error():
    truth = np.full((8, 8), 100.0)
    assert compute_psnr(truth + 1, truth, border=0) == pytest.approx(48.1308, abs=1e-4)
    assert compute_psnr(truth, truth, border=0) == float("inf")


def test_the_border_does_not_count():
    picture, truth = planes()
    changed = picture.copy()
    changed[:2], changed[:, -2:] = 0, 255
    assert compute_psnr(changed, truth, border=2) == compute_psnr(picture, truth, border=2)
    assert compute_ssim(changed, truth, border=2) == compute_ssim(picture, truth, border=2)
    assert compute_ssim(changed, truth, border=1) != compute_ssim(picture, truth, border=1)


def test_ssim_against_one_window_by_hand():
    """An 11x11 picture holds one window: equation 13 of Wang et al. with the weights written out."""
    picture, truth = (plane[:11, :11] for plane in planes())
    y, x = np.mgrid[-5:6, -5:6]
    weights = np.exp(-(x**2 + y**2) / 4.5)
    weights /= weights.sum()
    mean_a, mean_b = (weights * picture).sum(), (weights * truth).sum()
    variance_a, variance_b = (weights * (picture - mean_a) ** 2).sum(), (weights * (truth - mean_b) ** 2).sum()
    covariance = (weights * (picture - mean_a) * (truth - mean_b)).sum()
    want = (2 * mean_a * mean_b + 6.5025) * (2 * covariance + 58.5225)
    want /= (mean_a**2 + mean_b**2 + 6.5025) * (variance_a + variance_b + 58.5225)
    assert compute_ssim(picture, truth, border=0) == pytest.approx(want, abs=1e-12)


def test_ssim_of_less_than_a_window():
    with pytest.raises(ValueError, match="11x11"):
        compute_ssim(np.zeros((14, 30)), np.zeros((14, 30)), border=2)


def test_scores_of_maps_are_of_the_hci_benchmark():
    found = np.array([[0.5, 0.58], [0.44, 1.5]], np.float32)
    score = score_map(found, np.full((2, 2), 0.5, np.float32))
    assert (score.pixels, score.bad) == (4, 0.5)  # 0.08 and 1 are more than 0.07
    assert score.mse == pytest.approx(100 * (0.08**2 + 0.06**2 + 1) / 4, rel=1e-5)


def test_a_mean_is_over_pictures():
    mean = average("set", {"a": (30.0, 0.9), "b": (34.0, 0.96)})
    assert (mean.data, mean.pictures, mean.psnr, mean.ssim) == ("set", 2, 32.0, 0.93)
