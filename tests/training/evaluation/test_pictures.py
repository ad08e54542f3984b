from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
from ciir import ModelError, models
from ciir.models import processor
from ciir.models.catalogue import SHIPPED
from ciir.models.single.interpolation import Nearest
from ciir.models.single.network import SingleImageNetwork
from ciir.training.evaluation.pictures import describe_protocol, load_model, score
from tests.support.paths import SHARED

IMAGES = SHARED / "data" / "images"
needs_shared = pytest.mark.skipif(not IMAGES.is_dir(), reason="needs ../shared")


def save(folder: Path, name: str, pixels: np.ndarray) -> None:
    Image.fromarray(pixels).save(folder / name)


@needs_shared
@pytest.mark.parametrize(("data", "psnr", "ssim"), [("Set5", 33.66, 0.9299), ("Set14", 30.24, 0.8688)])
def test_bicubic_scores_what_is_published(data, psnr, ssim):
    scored = score(models.load_upscaler("bicubic"), IMAGES / data)
    assert scored.psnr == pytest.approx(psnr, abs=0.05)
    assert scored.ssim == pytest.approx(ssim, abs=0.001)
    assert scored.pictures == {"Set5": 5, "Set14": 14}[data]


@needs_shared
def test_the_measured_accuracy_is_the_cards():
    (entry,) = (entry for entry in models.list_entries() if entry.name == "paper")
    (claimed,) = (score for score in entry.card.accuracy if score.data == "Set5")
    measured = score(load_model("paper"), IMAGES / "Set5")
    assert measured.psnr == pytest.approx(claimed.psnr, abs=0.01)
    assert measured.ssim == pytest.approx(claimed.ssim, abs=0.0002)
    assert measured.psnr >= 36.5


@needs_shared
def test_emulated_int8_has_the_cards_accuracy(monkeypatch):
    """The card's figures are of a processor with VNNI."""
    monkeypatch.setattr(processor, "int8_unsupported_reason", lambda: "this processor has no VNNI")
    network = SingleImageNetwork(SHIPPED / "fast-int8.json", emulates_int8=True)
    (claimed,) = (score for score in network.card.accuracy if score.data == "Set5")
    measured = score(network, IMAGES / "Set5")
    assert measured.psnr == pytest.approx(claimed.psnr, abs=0.002)
    assert measured.ssim == pytest.approx(claimed.ssim, abs=0.00005)


def test_a_known_error(tmp_path):
    """Nearest gives the HR picture but for one grey level: 20 log10(255) dB on a grey picture's own Y."""
    low = np.random.default_rng(0).integers(0, 255, (10, 12), np.uint8)
    save(tmp_path, "a_LR.png", low)
    save(tmp_path, "a_HR.png", low.repeat(2, axis=0).repeat(2, axis=1) + np.uint8(1))
    scored = score(Nearest(2), tmp_path)
    assert (scored.data, scored.pictures) == (tmp_path.name, 1)
    assert scored.psnr == pytest.approx(48.1308, abs=1e-4)
    assert 0.99 < scored.ssim < 1


@pytest.mark.parametrize("degradation", ["", "box"])
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_pictures_of_fewer_bits_have_the_scores_of_8(tmp_path, bits, degradation):
    """In files of 16 bits; the darker picture uses a bit less than the camera has."""
    rng = np.random.default_rng(1)
    for name, most in (("a", 256), ("b", 120)):
        high = rng.integers(0, most, (24, 28), np.uint8)
        for kind, pixels in (("HR", high), ("LR", high[::2, ::2])):
            (tmp_path / "eight").mkdir(exist_ok=True)
            (tmp_path / "more").mkdir(exist_ok=True)
            save(tmp_path / "eight", f"{name}_{kind}.png", pixels)
            save(tmp_path / "more", f"{name}_{kind}.png", pixels.astype(np.uint16) << (bits - 8))
    eight, more = (score(Nearest(2), tmp_path / name, degradation=degradation) for name in ("eight", "more"))
    assert more.psnr == pytest.approx(eight.psnr, abs=0.05)
    assert more.ssim == pytest.approx(eight.ssim, abs=1e-3)


def test_only_published_pictures_have_the_published_protocol():
    published, own = Path("a/Set5"), Path("b/mine")
    assert "LR: MATLAB's bicubic imresize, as supplied by SelfExSR. SSIM" in describe_protocol([published])
    assert "LR: as given in the folder. SSIM" in describe_protocol([own])
    assert "LR: as given in the folder. SSIM" in describe_protocol([published, own])
    assert "LR: box, to 8 bits. SSIM" in describe_protocol([published], "box")
    assert "LR: point, to 8 bits; the truth is the mean of each 2x2 pixels" in describe_protocol([published], "point")


def test_no_pairs(tmp_path):
    with pytest.raises(ValueError, match=r"no \*_LR\.png"):
        score(Nearest(2), tmp_path)


def test_a_pair_without_its_truth(tmp_path):
    save(tmp_path, "a_LR.png", np.zeros((9, 9), np.uint8))
    with pytest.raises(ValueError, match=r"a_HR\.png: missing"):
        score(Nearest(2), tmp_path)


def test_a_pair_of_another_scale(tmp_path):
    save(tmp_path, "a_LR.png", np.zeros((9, 9), np.uint8))
    save(tmp_path, "a_HR.png", np.zeros((27, 27), np.uint8))
    with pytest.raises(ValueError, match="27x27 pixels, but nearest makes 18x18"):
        score(Nearest(2), tmp_path)


@needs_shared
@pytest.mark.parametrize(("kind", "psnr"), [("bicubic", 33.68), ("box", 33.86), ("point", 30.15)])
def test_degradations_of_set5(kind, psnr):
    """Bicubic LR that is made here scores as the supplied one does, but for its border: 33.66 dB."""
    scored = score(models.load_upscaler("bicubic"), IMAGES / "Set5", degradation=kind)
    assert scored.psnr == pytest.approx(psnr, abs=0.02)
    assert (scored.data, scored.pictures) == (f"Set5 ({kind})", 5)


def test_any_pictures_can_be_degraded(tmp_path):
    """Nearest undoes a box of flat 2x2 cells; grey stays one channel, odd sides are cut."""
    low = np.random.default_rng(0).integers(0, 255, (12, 13, 3), np.uint8)
    flat = low.repeat(2, axis=0).repeat(2, axis=1)
    save(tmp_path, "colour.png", np.pad(flat, ((0, 1), (0, 1), (0, 0))))
    save(tmp_path, "grey.tif", flat[..., 0])
    (tmp_path / "notes.txt").write_text("not a picture")
    assert score(Nearest(2), tmp_path, degradation="box") == models.cards.Accuracy(
        f"{tmp_path.name} (box)", 2, float("inf"), 1.0
    )


def test_errors_of_pictures(tmp_path):
    with pytest.raises(ValueError, match="no picture in it"):
        score(Nearest(2), tmp_path, degradation="box")
    save(tmp_path, "a.png", np.zeros((1, 9), np.uint8))
    with pytest.raises(ValueError, match=r"a\.png: a picture of 1x9 is smaller"):
        score(Nearest(2), tmp_path, degradation="box")
    save(tmp_path, "a.png", np.zeros((14, 14), np.uint8))
    with pytest.raises(ValueError, match=r"a\.png: a picture of \(10, 10\).*SSIM's window.*remove it"):
        score(Nearest(2), tmp_path, degradation="box")
    save(tmp_path, "a.png", np.zeros((20, 20), np.uint8))
    with pytest.raises(ValueError, match="no 'blur' here"):
        score(Nearest(2), tmp_path, degradation="blur")


@pytest.mark.parametrize(
    ("card", "scale", "words"),
    [
        ("field.json", 2, "field takes the views of a light field, not pictures; give --light-field"),
        ("fast.json", 4, "scale: fast upscales by 2, not 4; give that"),
    ],
)
def test_cards_that_do_not_fit(card, scale, words):
    with pytest.raises(ModelError, match=words):
        load_model(str(SHIPPED / card), scale=scale)


def test_supplied_pairs_need_no_torch(recipe, monkeypatch):
    import subprocess
    import sys

    code = (
        "import sys; from pathlib import Path;"
        "from ciir.training.evaluation import light_fields;"
        "from ciir.training.evaluation.pictures import *;"
        f"print(score(load_model('nearest'), Path({recipe.validate!r})).pictures, 'torch' in sys.modules)"
    )
    run = subprocess.run(  # noqa: S603 - the words are this test's own
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    )
    assert run.stdout == "2 False\n"
