"""Examples for calibration: inputs by name and their truth."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
from PIL import Image

from ciir.models.light_field.planes import REACH, describe_window
from ciir.models.light_field.windows import select_axis
from ciir.training.data import mesh_views
from ciir.training.data.light_field.layered_scenes import LUMA, TEXTURE
from ciir.training.export import calibration
from ciir.training.export.calibration import Example


@pytest.fixture(autouse=True)
def one_scene(monkeypatch):
    """Rendering all of them takes 20 seconds."""
    monkeypatch.setattr(calibration, "SCENES", ["vase"])
    monkeypatch.setattr(calibration, "VIEWS", 1)
    monkeypatch.setattr(calibration, "LIGHT_FIELDS", 1)
    monkeypatch.setattr(calibration, "BATCHES", 2)
    monkeypatch.setattr(calibration, "SIDE", 16)


def check(example: Example) -> None:
    image = example.inputs["image"]
    assert image.dtype == np.float32
    assert (example.high.dtype, example.high.shape) == (np.uint8, (2 * image.shape[2], 2 * image.shape[3], 3))
    assert 0 <= image.min() <= image.max() <= 1


def test_pictures(recipe):
    found = calibration.make_picture_examples([Path(recipe.train)], 2)
    assert [one.inputs["image"].shape[2:] for one in found[:3]] == [(16, 16), (16, 16), (5, 5)]  # bicubic, box, point
    assert len(found) == 3 + 2
    for one in found:
        assert one.inputs.keys() == {"image"}
        check(one)


def test_pictures_of_12_bits_fill_the_range(recipe, tmp_path):
    full = np.random.default_rng(0).integers(0, 256, (40, 40), np.uint8)
    for folder, pixels in (("full", full), ("dark", full.astype(np.uint16) * 16)):
        (tmp_path / folder).mkdir()
        Image.fromarray(pixels).save(tmp_path / folder / "a.png")
    (one, *_), (other, *_) = (calibration.make_picture_examples([tmp_path / name], 2) for name in ("full", "dark"))
    assert np.abs(one.high.astype(int) - other.high).max() <= 1


def test_light_fields(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (TEXTURE, TEXTURE, 3), np.uint8)
    Image.fromarray(pixels).save(tmp_path / "texture.png")
    found = calibration.make_light_field_examples([tmp_path], 2, planes=6)
    assert len(found) == 2 * calibration.SCENES_PER_BATCH + 2
    for one in found:
        assert list(one.inputs) == ["image", "around", "down", "across", "window"]
        check(one)
        image, around, down, across, window = one.inputs.values()
        assert around.shape == (1, 25, *image.shape[2:])
        assert down.shape == across.shape == (6, 3, 5, 2 * REACH + 1)
        assert {part.dtype for part in one.inputs.values()} == {np.dtype(np.float32)}
        own = around[0, int(5 * 2 * window[0] + 2 * window[2])]
        np.testing.assert_allclose(own, np.tensordot(LUMA, image[0], 1), atol=0.6 / 255)  # one is in 8 bits
    drawn = found[: 2 * calibration.SCENES_PER_BATCH]
    assert len({one.high.tobytes() for one in drawn}) == len(drawn)
    rendered = found[-1]
    seen = mesh_views.render_window(calibration.load_scene("vase"), seed=0, index=0)
    wanted = describe_window(select_axis(2, 5), select_axis(2, 5), seen.disparities, 6)
    for part, name in zip(wanted, ("down", "across", "window"), strict=True):
        np.testing.assert_array_equal(rendered.inputs[name], part)
    np.testing.assert_array_equal(rendered.high, seen.high.permute(1, 2, 0))
    np.testing.assert_array_equal(rendered.inputs["around"][0] * 255, seen.views["lenslet"])


def test_folders_without_usable_pictures(recipe, tmp_path):
    with pytest.raises(ValueError, match="no picture in it"):
        calibration.make_picture_examples([tmp_path], 2)
    with pytest.raises(ValueError, match="no picture is as large as"):
        calibration.make_light_field_examples([Path(recipe.train)], 2, planes=8)
