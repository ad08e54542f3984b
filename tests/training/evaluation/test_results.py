from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")

from ciir.renderer.light_field import LightField
from ciir.renderer.writers.pictures import encode_png
from ciir.training.evaluation.metrics import compute_psnr, convert_to_luma
from ciir.training.evaluation.results import compare_maps, compare_views, is_map


def make_views(dtype=np.uint8, channels=3):
    random = np.random.default_rng(0)
    return random.integers(0, np.iinfo(dtype).max, (3, 4, 20, 24, channels), dtype)


def save(path, views, sense="cameras"):
    LightField(views, is_ordered=True, depth_sense=sense).save(path)
    return path


@pytest.mark.parametrize("channels", [1, 3])
def test_each_view_has_its_score(tmp_path, channels):
    views = make_views(channels=channels)
    other = views.copy()
    other[2, 1, 5:9, 5:9] = 0
    found = compare_views(save(tmp_path / "a.npz", other), save(tmp_path / "b.npz", views), border=2)
    expected = compute_psnr(convert_to_luma(other[2, 1]), convert_to_luma(views[2, 1]), border=2)
    assert found.views[2, 1][0] == expected < 40
    assert all(psnr == np.inf for view, (psnr, _) in found.views.items() if view != (2, 1))
    assert found.mean.pictures == 12
    assert found.notes == ()


def test_the_border_is_cut(tmp_path):
    views = make_views()
    other = views.copy()
    other[:, :, :2] = other[:, :, :, -2:].mean()
    other[:, :, :, :2] = 0
    files = save(tmp_path / "a.npz", other), save(tmp_path / "b.npz", views)
    assert compare_views(*files, border=2).mean.psnr == np.inf
    assert compare_views(*files, border=1).mean.psnr < 40


def test_views_counted_from_other_ends_are_compared_in_one_order(tmp_path):
    views = make_views()
    lenses = save(tmp_path / "a.npz", views[::-1, ::-1], "lenses")
    found = compare_views(lenses, save(tmp_path / "b.npz", views), border=2)
    assert found.mean.psnr == np.inf
    assert found.notes[-1] == "views of a.npz are counted from the other end than those of b.npz: put right"


def test_views_in_reverse_order_are_noted(tmp_path):
    views = make_views()
    found = compare_views(save(tmp_path / "a.npz", views[::-1, ::-1]), save(tmp_path / "b.npz", views), border=2)
    assert found.mean.psnr < 20
    assert "view 0,0 of a.npz is closer to the last view of b.npz" in found.notes[-1]


def test_pictures_are_compared_as_pictures_of_the_same_bits(tmp_path):
    picture = np.random.default_rng(0).integers(0, 1023, (30, 40, 3), np.uint16)  # a camera of 10 bits
    paths = [tmp_path / name for name in ("a.png", "b.png", "c.png")]
    for path, levels in zip(paths, (picture, picture, picture // 4), strict=True):
        path.write_bytes(encode_png(levels if path.name != "c.png" else levels.astype(np.uint8)))
    assert compare_views(paths[0], paths[1], border=2).mean.psnr == np.inf
    assert compare_views(paths[2], paths[1], border=2).mean.psnr > 48  # half a level
    opaque = np.concatenate([picture // 4, np.full_like(picture[..., :1], 255)], axis=2).astype(np.uint8)
    paths[0].write_bytes(encode_png(opaque))
    assert compare_views(paths[0], paths[2], border=2).mean.psnr == np.inf
    opaque[3, 4, 3] = 0
    paths[0].write_bytes(encode_png(opaque))
    with pytest.raises(ValueError, match="not all opaque"):
        compare_views(paths[0], paths[2], border=2)


def test_what_differs_is_named(tmp_path):
    views = make_views()
    truth = save(tmp_path / "b.npz", views)
    for other, words in (
        (views[:2], "2x4 views of 20x24 pixels, 3 channels, but"),
        (views[..., :1], "grey, but"),
        (views[:, :, :10], "3x4 views of 10x24 pixels"),
    ):
        with pytest.raises(ValueError, match=words):
            compare_views(save(tmp_path / "a.npz", other), truth, border=2)
    small = save(tmp_path / "s.npz", views[:, :, :14])
    with pytest.raises(ValueError, match="SSIM needs more than 14 each way"):
        compare_views(small, small, border=2)


def write_pfm(path, plane):
    path.write_bytes(b"Pf\n%d %d\n-1.0\n" % plane.shape[::-1] + plane[::-1].astype("<f4").tobytes())
    return path


def test_disparity_maps(tmp_path):
    truth = np.random.default_rng(0).normal(0, 1, (5, 8)).astype(np.float32)
    found = truth.copy()
    found[0, 0] += 0.1
    found[1, 1] = np.nan
    truth[4, 7] = np.inf
    np.save(tmp_path / "a.npy", found)
    score = compare_maps(tmp_path / "a.npy", write_pfm(tmp_path / "t.pfm", truth))
    assert score.pixels == 39
    assert score.bad == pytest.approx(2 / 39)
    assert score.mse == pytest.approx(100 * 0.01 / 38, rel=1e-4)
    with pytest.raises(ValueError, match=r"5x8 pixels, but .* has 5x7"):
        compare_maps(tmp_path / "a.npy", write_pfm(tmp_path / "u.pfm", truth[:, :7]))
    with pytest.raises(ValueError, match="no pixel is finite"):
        compare_maps(tmp_path / "a.npy", write_pfm(tmp_path / "n.pfm", np.full((5, 8), np.inf)))
    (tmp_path / "x.pfm").write_bytes(b"Pf\n5")
    with pytest.raises(ValueError, match="not a disparity map that is read"):
        compare_maps(tmp_path / "x.pfm", tmp_path / "t.pfm")


def test_which_files_are_maps(tmp_path):
    np.save(tmp_path / "map.npy", np.zeros((3, 4)))
    np.save(tmp_path / "views.npy", np.zeros((3, 4, 5, 6, 3), np.uint8))
    assert [is_map(tmp_path / name) for name in ("map.npy", "views.npy", "no.pfm")] == [True, False, False]
    assert not is_map(Path("a.png"))
