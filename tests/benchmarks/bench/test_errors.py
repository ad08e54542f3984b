import numpy as np
import pytest

from ciir.benchmarks.bench.errors import compare
from ciir.training.evaluation.metrics import compute_psnr, compute_ssim, rgb_to_luma

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")


def pictures(seed, shape=(2, 40, 30, 3)):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def test_equal_pictures_have_no_error():
    truth = pictures(0)
    error = compare(truth, truth)
    assert (error.rmse, error.psnr, error.gradient, error.gradient_worst) == (0.0, np.inf, 0.0, 0.0)
    assert error.ssim == pytest.approx(1.0, abs=1e-12)


def test_one_picture_scores_as_the_published_protocol_without_a_border():
    made, truth = pictures(1, (1, 40, 30, 3)), pictures(2, (1, 40, 30, 3))
    error = compare(made, truth)
    assert error.psnr == pytest.approx(compute_psnr(rgb_to_luma(made[0]), rgb_to_luma(truth[0]), border=0), abs=1e-9)
    assert error.ssim == pytest.approx(compute_ssim(rgb_to_luma(made[0]), rgb_to_luma(truth[0]), border=0), abs=1e-12)


def test_a_constant_offset_has_no_gradient_error():
    truth = np.full((1, 20, 20, 3), 100, np.uint8)
    error = compare(truth + 10, truth)
    # Y of BT.601 spans 219 levels of 255: an offset of 10 in R, G and B is 10 * 219/255 in Y.
    assert error.rmse == pytest.approx(10 * 219 / 255, abs=1e-3)
    assert error.gradient == pytest.approx(0.0, abs=1e-9)


def test_the_worst_hundredth_is_the_edge():
    truth = np.zeros((1, 101, 101, 3), np.uint8)
    made = truth.copy()
    made[0, :, 50:] = 255  # a step that isn't there: 100 of 10,000 gradients
    error = compare(made, truth)
    assert error.gradient_worst == pytest.approx(219.0, abs=0.01)
    assert error.gradient == pytest.approx(2.19, abs=0.01)


def test_the_object_alone_counts():
    truth, made = pictures(3), pictures(3)
    mask = np.zeros(truth.shape[:3], bool)
    mask[:, 5:20, 5:20] = True
    made[:, 25:, 25:] = 0  # wrong, but outside
    assert compare(made, truth, mask).psnr == np.inf
    assert compare(made, truth).psnr < 30


def test_views_without_the_object_and_other_shapes_are_named():
    truth = pictures(4)
    with pytest.raises(ValueError, match="nothing of the object"):
        compare(truth, truth, np.zeros(truth.shape[:3], bool))
    with pytest.raises(ValueError, match=r"pictures of \(2, 39, 30, 3\)"):
        compare(truth[:, 1:], truth)


def test_small_views_have_no_ssim():
    truth = pictures(5, (1, 8, 8, 3))
    assert np.isnan(compare(truth, truth).ssim)
