import numpy as np
import pytest
import tifffile

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")

from ciir.renderer.focus.disparity import DisparityMap
from ciir.renderer.writers.depth import write_disparity
from ciir.renderer.writers.pictures import encode_png
from ciir.training.evaluation.maps import compare_maps, is_map, read_map

VALUES = np.random.default_rng(1).normal(size=(5, 7)).astype(np.float32)
SEEN = np.ones((5, 7), np.float32)


def write_pfm(path, plane):
    path.write_bytes(b"Pf\n%d %d\n-1.0\n" % plane.shape[::-1] + plane[::-1].astype("<f4").tobytes())
    return path


def write_map(path, values=VALUES, confidence=SEEN):
    write_disparity(path, DisparityMap((0, 0), values, confidence, np.linspace(-1, 1, 9), "cameras"))
    return path


def test_disparity_maps(tmp_path):
    truth = np.random.default_rng(0).normal(0, 1, (5, 8)).astype(np.float32)
    found = truth.copy()
    found[0, 0] += 0.1
    found[1, 1] = np.nan
    truth[4, 7] = np.inf
    np.save(tmp_path / "a.npy", found)
    score, notes = compare_maps(tmp_path / "a.npy", write_pfm(tmp_path / "t.pfm", truth))
    assert (score.pixels, score.not_finite, score.without_truth) == (39, 1, 1)
    assert notes == (
        "39 of 40 pixels of t.pfm count; 1 without a finite value are left out",
        "pixels of a.npy without a finite value: 1; they count as bad, but not in the mean square error",
    )
    assert score.bad == pytest.approx(2 / 39)
    assert score.mse == pytest.approx(100 * 0.01 / 38, rel=1e-4)
    with pytest.raises(ValueError, match=r"5x8 pixels, but .* has 5x7"):
        compare_maps(tmp_path / "a.npy", write_pfm(tmp_path / "u.pfm", truth[:, :7]))
    with pytest.raises(ValueError, match="no pixel is finite"):
        compare_maps(tmp_path / "a.npy", write_pfm(tmp_path / "n.pfm", np.full((5, 8), np.inf)))
    for name, content in (("x.pfm", b"Pf\n5"), ("x.tif", b"II*\0zz"), ("x.npy", b"\x93NUMPY")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ValueError, match="not a disparity map that is read"):
            compare_maps(tmp_path / name, tmp_path / "t.pfm")
    with pytest.raises(ValueError, match="not a disparity map; give"):
        compare_maps(write_picture(tmp_path / "p.png"), tmp_path / "t.pfm")
    for name, message in (("", "a folder"), ("gone.npy", "no such file")):
        with pytest.raises(
            ValueError, match=rf"{tmp_path / name}: {message}; .*t\.pfm is a disparity map, so give one"
        ):
            compare_maps(tmp_path / name, tmp_path / "t.pfm")


def write_picture(path):
    path.write_bytes(encode_png(np.full((5, 8, 1), 900, np.uint16)))
    return path


@pytest.mark.parametrize("name", ["m.pfm", "m.tif", "m.tiff", "m.png", "m.npy"])
def test_what_ciir_depth_writes_is_a_map(tmp_path, name):
    path = write_map(tmp_path / name)
    assert is_map(path)
    bound = np.ptp(VALUES) / 0xFFFF if name == "m.png" else 0
    np.testing.assert_allclose(read_map(path), VALUES, rtol=0, atol=bound)


@pytest.mark.parametrize("suffix", [".pfm", ".png", ".tif", ".npy"])
def test_pixels_that_are_not_seen_do_not_count(tmp_path, suffix):
    confidence = SEEN.copy()
    confidence[:2] = 0
    truth = write_map(tmp_path / f"exact{suffix}", confidence=confidence)
    found = VALUES.copy()
    found[:2] += 1
    found[4, 3] += 0.2
    score, (note,) = compare_maps(write_map(tmp_path / f"found{suffix}", found, 0 * SEEN), truth)
    assert score.pixels == 21
    assert score.bad == 1 / 21
    assert note == (
        f"21 of 35 pixels of exact{suffix} count; 14 with the confidence 0 in exact_confidence{suffix} are left out"
    )
    with pytest.raises(ValueError, match="no pixel is finite with a confidence above 0"):
        compare_maps(truth, tmp_path / f"found{suffix}")


def test_a_confidence_of_another_size(tmp_path):
    truth = write_map(tmp_path / "t.npy")
    np.save(tmp_path / "t_confidence.npy", SEEN[:3])
    with pytest.raises(ValueError, match=r"t_confidence\.npy: 3x7 pixels, but .*t\.npy has 5x7"):
        compare_maps(truth, truth)


def test_which_files_are_maps(tmp_path):
    np.save(tmp_path / "map.npy", np.zeros((3, 4)))
    np.save(tmp_path / "levels.npy", np.zeros((3, 4), np.uint8))
    np.save(tmp_path / "views.npy", np.zeros((3, 4, 5, 6, 3), np.uint8))
    tifffile.imwrite(tmp_path / "rgb.tif", np.zeros((9, 8, 3), np.float32), photometric="rgb")
    tifffile.imwrite(tmp_path / "stack.tif", np.zeros((3, 9, 8), np.float32), photometric="minisblack")
    tifffile.imwrite(tmp_path / "grey.tif", np.zeros((9, 8), np.uint16))
    tifffile.imwrite(tmp_path / "double.tif", np.zeros((9, 8)))
    write_picture(tmp_path / "grey.png")
    names = {path.name for path in tmp_path.iterdir()}
    assert {name for name in names if is_map(tmp_path / name)} == {"map.npy", "double.tif"}
    assert not is_map(tmp_path / "no.pfm")
