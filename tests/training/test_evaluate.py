from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import models
from models.baselines import Nearest
from models.catalogue import SHIPPED
from training.evaluate import evaluate, evaluate_folder

IMAGES = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "images"
needs_shared = pytest.mark.skipif(not IMAGES.is_dir(), reason="needs ../shared")


def save(folder: Path, name: str, pixels: np.ndarray) -> None:
    Image.fromarray(pixels).save(folder / name)


@needs_shared
@pytest.mark.parametrize(("data", "psnr", "ssim"), [("Set5", 33.66, 0.9299), ("Set14", 30.24, 0.8688)])
def test_bicubic_scores_what_is_published(data, psnr, ssim):
    score = evaluate(models.load("bicubic"), IMAGES / data)
    assert score.psnr == pytest.approx(psnr, abs=0.05)
    assert score.ssim == pytest.approx(ssim, abs=0.001)
    assert score.pictures == {"Set5": 5, "Set14": 14}[data]


@needs_shared
def test_the_card_tells_the_accuracy_that_is_measured():
    (entry,) = (entry for entry in models.entries() if entry.name == "lite")
    (claimed,) = (score for score in entry.card.accuracy if score.data == "Set5")
    measured = evaluate_folder("lite", IMAGES / "Set5")
    assert measured.psnr == pytest.approx(claimed.psnr, abs=0.01)
    assert measured.ssim == pytest.approx(claimed.ssim, abs=0.0002)
    assert measured.psnr >= 36.5


def test_a_known_error(tmp_path):
    """Nearest gives the HR picture but for one grey level: 20 log10(255) dB on a grey picture's own Y."""
    low = np.random.default_rng(0).integers(0, 255, (10, 12), np.uint8)
    save(tmp_path, "a_LR.png", low)
    save(tmp_path, "a_HR.png", low.repeat(2, axis=0).repeat(2, axis=1) + np.uint8(1))
    score = evaluate(Nearest(2), tmp_path)
    assert (score.data, score.pictures) == (tmp_path.name, 1)
    assert score.psnr == pytest.approx(48.1308, abs=1e-4)
    assert 0.99 < score.ssim < 1


def test_a_model_by_name_and_by_its_card(recipe):
    folder = Path(recipe.validate)
    assert evaluate_folder(str(SHIPPED / "lite.json"), folder) == evaluate_folder("lite", folder)
    with pytest.raises(models.UnknownModel):
        evaluate_folder("fancy", folder)


def test_no_pairs(tmp_path):
    with pytest.raises(ValueError, match=r"no \*_LR\.png"):
        evaluate(Nearest(2), tmp_path)


def test_a_pair_without_its_truth(tmp_path):
    save(tmp_path, "a_LR.png", np.zeros((9, 9), np.uint8))
    with pytest.raises(ValueError, match=r"a_HR\.png: missing"):
        evaluate(Nearest(2), tmp_path)


def test_a_pair_of_another_scale(tmp_path):
    save(tmp_path, "a_LR.png", np.zeros((9, 9), np.uint8))
    save(tmp_path, "a_HR.png", np.zeros((27, 27), np.uint8))
    with pytest.raises(ValueError, match="27x27 pixels, where nearest makes 18x18"):
        evaluate(Nearest(2), tmp_path)
