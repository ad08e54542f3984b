import math

import numpy as np
import pytest

from ciir.service.demo import scores
from ciir.training.evaluation import metrics
from tests.support.inputs import make_picture


def test_scores_are_those_of_the_published_protocol():
    pytest.importorskip("skimage")
    truth = make_picture(40, 50, seed=1)
    picture = np.clip(truth.astype(int) + np.arange(50)[:, None] % 7 - 3, 0, 255).astype(np.uint8)
    one, other = metrics.rgb_to_luma(picture), metrics.rgb_to_luma(truth)
    score = scores.compare(picture, truth)
    assert score.psnr == pytest.approx(metrics.compute_psnr(one, other, border=scores.BORDER), abs=1e-9)
    assert score.ssim == pytest.approx(metrics.compute_ssim(one, other, border=scores.BORDER), abs=1e-9)
    assert score.ssim < 0.9999


def test_equal_pictures():
    picture = make_picture(20, 20)
    score = scores.compare(picture, picture)
    assert score.psnr == math.inf
    assert score.ssim == pytest.approx(1)
    assert str(score) == "inf dB, SSIM 1.000"
