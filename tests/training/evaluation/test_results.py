import numpy as np
import pytest

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")

from ciir.renderer.light_field import LightField
from ciir.renderer.writers.pictures import encode_png, png
from ciir.training.evaluation.metrics import compute_psnr, convert_to_luma
from ciir.training.evaluation.results import compare


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
    found = compare(save(tmp_path / "a.npz", other), save(tmp_path / "b.npz", views), border=2)
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
    assert compare(*files, border=2).mean.psnr == np.inf
    assert compare(*files, border=1).mean.psnr < 40


def test_views_counted_from_other_ends_are_compared_in_one_order(tmp_path):
    views = make_views()
    lenses = save(tmp_path / "a.npz", views[::-1, ::-1], "lenses")
    found = compare(lenses, save(tmp_path / "b.npz", views), border=2)
    assert found.mean.psnr == np.inf
    assert found.notes[-1] == "views of a.npz are counted from the other end than those of b.npz: put right"


def test_views_in_reverse_order_are_noted(tmp_path):
    views = make_views()
    found = compare(save(tmp_path / "a.npz", views[::-1, ::-1]), save(tmp_path / "b.npz", views), border=2)
    assert found.mean.psnr < 20
    assert "view 0,0 of a.npz is closer to the last view of b.npz" in found.notes[-1]


def test_pictures_are_compared_as_pictures_of_the_same_bits(tmp_path):
    picture = np.random.default_rng(0).integers(0, 1023, (30, 40, 3), np.uint16)  # a camera of 10 bits
    paths = [tmp_path / name for name in ("a.png", "b.png", "c.png")]
    for path, levels in zip(paths, (picture, picture, picture // 4), strict=True):
        path.write_bytes(encode_png(levels if path.name != "c.png" else levels.astype(np.uint8)))
    assert compare(paths[0], paths[1], border=2).mean.psnr == np.inf
    assert compare(paths[2], paths[1], border=2).mean.psnr > 48  # half a level
    opaque = np.concatenate([picture // 4, np.full_like(picture[..., :1], 255)], axis=2).astype(np.uint8)
    paths[0].write_bytes(encode_png(opaque))
    assert compare(paths[0], paths[2], border=2).mean.psnr == np.inf
    opaque[3, 4, 3] = 0
    paths[0].write_bytes(encode_png(opaque))
    with pytest.raises(ValueError, match="not all opaque"):
        compare(paths[0], paths[2], border=2)


@pytest.mark.parametrize("bits", [10, 12])
def test_the_truth_alone_sets_the_white_level(tmp_path, bits):
    white = 2**bits - 1
    truth = np.random.default_rng(0).integers(0, white + 1, (30, 40, 3), np.uint16)
    result = np.clip(truth.astype(int) + np.random.default_rng(1).integers(-99, 100, truth.shape), 0, white)
    over = result.copy()
    result[9, 9, 1], over[9, 9, 1] = white, white + 40
    files = [tmp_path / name for name in ("truth.png", "result.png", "over.png")]
    for path, levels in zip(files, (truth, result, over), strict=True):
        path.write_bytes(encode_png(levels.astype(np.uint16)))
    plain, clipped = (compare(path, files[0], border=2) for path in files[1:])
    assert plain.views == clipped.views
    assert plain.notes == (f"white is level {white:,}, because truth.png uses {bits} of 16 bits",)
    assert clipped.notes == (f"{plain.notes[0]}; samples of over.png above it, which count as white: 1",)


def test_white_of_16_bits_against_a_truth_of_8(tmp_path):
    truth = np.random.default_rng(0).integers(0, 100, (30, 40, 3), np.uint8)
    for name, levels in (
        ("truth.png", truth),
        ("same.png", truth * np.uint16(257)),
        ("dark.png", truth * np.uint16(4)),
    ):
        (tmp_path / name).write_bytes(encode_png(levels))
    found = compare(tmp_path / "same.png", tmp_path / "truth.png", border=2)
    assert (found.mean.psnr, found.notes) == (np.inf, ())
    (note,) = compare(tmp_path / "dark.png", tmp_path / "truth.png", border=2).notes
    assert note.startswith("dark.png uses 10 of 16 bits, but truth.png has 8 bits, so white is level 65,535; scale")


def test_what_differs_is_named(tmp_path):
    views = make_views()
    truth = save(tmp_path / "b.npz", views)
    for other, words in (
        (views[:2], "2x4 views of 20x24 pixels, 3 channels, but"),
        (views[..., :1], "grey, but"),
        (views[:, :, :10], "3x4 views of 10x24 pixels"),
    ):
        with pytest.raises(ValueError, match=words):
            compare(save(tmp_path / "a.npz", other), truth, border=2)
    small = save(tmp_path / "s.npz", views[:, :, :14])
    with pytest.raises(ValueError, match="SSIM needs more than 14 each way"):
        compare(small, small, border=2)


def test_maps_are_not_scored_as_pictures(tmp_path):
    picture, found = tmp_path / "a.png", tmp_path / "m.png"
    picture.write_bytes(encode_png(np.zeros((30, 40, 1), np.uint16)))
    found.write_bytes(png.encode(np.zeros((30, 40), np.uint16), {"offset": "0.0", "scale": "1e-5"}))
    with pytest.raises(ValueError, match=r"m\.png: a disparity map, but .*a\.png isn't one"):
        compare(found, picture, border=2)
