import io

import numpy as np
import pytest
from PIL import Image

from ciir.benchmarks.harm import pictures
from ciir.benchmarks.harm.light_fields import Variation
from ciir.errors import InvalidOption
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.pictures import upscale_files
from tests.support.inputs import make_picture

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")

from ciir.benchmarks.harm.score import reconstruct_case


def write_folder(folder, **files):
    folder.mkdir()
    for name, pixels in files.items():
        (folder / f"{name}.png").write_bytes(encode_png(pixels))
    return Bundle.from_path(folder)


def test_variations_have_every_value_of_every_factor():
    found = pictures.list_variations()
    assert len(set(found)) == len(found) == 2 * 11 + 1
    assert {one.noise for one in found} == {0, 2, 5, 10}
    assert {one.jpeg for one in found} == {0, 95, 90, 75, 50, 30}
    assert {one.degradation for one in found} == {"bicubic", "box", "point"}
    assert set(pictures.list_variations(quick=True)) <= set(found)


@pytest.mark.parametrize(("noise", "jpeg"), [(0, 0), (10, 0), (0, 75), (2, 90)])
def test_the_judged_picture_is_that_of_ciir_upscale_to_the_bit(noise, jpeg):
    truth = make_picture(96, 80, seed=1)
    (case,) = pictures.list_cases("noise", truth, [Variation("box", (1, 1), noise=noise, jpeg=jpeg)])
    assert np.array_equal(case.truth, truth)
    low = case.views[0, 0]
    means = truth.reshape(48, 2, 40, 2, 3).mean(axis=(1, 3))
    assert (np.abs(low - means).max() <= 0.5) == (not noise and not jpeg)
    written = {}
    upscale_files({"a.png": encode_png(low)}, {"a.png": "b.png"}, written.__setitem__, model="auto", scale=2)
    with Image.open(io.BytesIO(written["b.png"])) as made:
        assert np.array_equal(reconstruct_case(case, "auto").picture, np.asarray(made))
    assert case.factors == {"degradation": "box", "noise": str(noise), "jpeg": str(jpeg) if jpeg else "none"}


def test_high_resolution_pictures_are_read_cropped_to_their_middle(tmp_path):
    large, grey = make_picture(600, 40), make_picture(32, 40)[..., :1]
    files = {"a_HR": large, "a_LR": large[:300, :20], "b_HR": grey.astype(np.uint16) * 257, "c": grey}
    found = pictures.read_photographs("set", write_folder(tmp_path / "set", **files))
    assert list(found) == ["set/a", "set/b"]
    assert np.array_equal(found["set/a"], large[44:556])
    assert np.array_equal(found["set/b"], grey.repeat(3, axis=2))


def test_a_file_is_read_without_those_beside_it(tmp_path):
    write_folder(tmp_path / "set", a=make_picture(40, 40), b_HR=make_picture(40, 40))
    assert list(pictures.read_photographs("a", Bundle.from_path(tmp_path / "set" / "a.png"))) == ["a/a.png"]


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, "set: no picture in it; give a folder of photographs"),
        ({"a": np.zeros((8, 40, 3), np.uint8)}, "set/a.png: 8x40 pixels; give pictures of 32x32 or more"),
        ({"a": np.zeros((40, 40, 4), np.uint8)}, "set/a.png: views of 4 channels, not all opaque; give grey or RGB"),
    ],
)
def test_others_are_refused(tmp_path, files, message):
    with pytest.raises(InvalidOption, match=f"^{message}$"):
        pictures.read_photographs("set", write_folder(tmp_path / "set", **files))


def test_drawn_pictures_have_detail():
    for name, picture in pictures.draw_pictures(quick=True).items():
        assert picture.shape == (128, 128, 3)
        assert picture.std() > 20, name
