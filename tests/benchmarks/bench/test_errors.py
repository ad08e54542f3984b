import numpy as np
import pytest

from ciir.benchmarks.bench.errors import compare, find_worst_window
from ciir.training.evaluation.metrics import compute_psnr, compute_ssim, rgb_to_luma

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")


def pictures(seed, shape=(2, 40, 30, 3)):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def test_equal_pictures_have_no_error():
    truth = pictures(0)
    error = compare(truth, truth)
    assert (error.rmse, error.psnr) == (0.0, np.inf)
    assert error.ssim == pytest.approx(1.0, abs=1e-12)


def test_one_picture_scores_as_the_published_protocol_without_a_border():
    made, truth = pictures(1, (1, 40, 30, 3)), pictures(2, (1, 40, 30, 3))
    error = compare(made, truth)
    assert error.psnr == pytest.approx(compute_psnr(rgb_to_luma(made[0]), rgb_to_luma(truth[0]), border=0), abs=1e-9)
    assert error.ssim == pytest.approx(compute_ssim(rgb_to_luma(made[0]), rgb_to_luma(truth[0]), border=0), abs=1e-12)


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


def test_the_window_of_the_crops_is_the_worst():
    truth = np.zeros((100, 120, 3), np.uint8)
    picture, other = truth.copy(), truth.copy()
    picture[60:70, 70:80] = 50
    other[10:40, 10:40] = 90
    rows, cols = find_worst_window(picture, truth, other, side=48)
    assert rows.start <= 60
    assert rows.stop >= 70
    assert cols.start <= 70
    assert cols.stop >= 80
    assert (rows.stop - rows.start, cols.stop - cols.start) == (48, 48)
