import numpy as np
import pytest

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")

from ciir.renderer.light_field import LightField
from ciir.renderer.writers.pictures import encode_png, png
from ciir.training.evaluation.metrics import compute_psnr, convert_to_luma
from ciir.training.evaluation.results import compare
from tests.support.light_fields import make_views as make_layers
from tests.support.light_fields import write_views


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


@pytest.mark.parametrize(("sense", "shown"), [("cameras", "lenses"), ("lenses", "cameras")])
def test_pictures_decide_between_two_orders(tmp_path, sense, shown):
    """The result states a wrong depth sense."""
    views = make_views()
    made = views[::-1, ::-1] if shown == "lenses" else views
    found = compare(save(tmp_path / "a.npz", made, sense), save(tmp_path / "b.npz", views), border=2)
    assert found.mean.psnr == np.inf
    (note,) = found.notes
    assert note == (
        f"a.npz is read with the depth sense {sense}, but against b.npz (cameras) its pictures show {shown}: they are "
        f"compared so; read it with depth_sense {shown}"
    )


def test_the_depth_senses_decide_where_pictures_do_not(tmp_path):
    views = np.repeat(np.repeat(make_views()[:1, :1], 3, 0), 4, 1)
    views[2, 3, 9, 9] ^= 1
    found = compare(save(tmp_path / "a.npz", views, "lenses"), save(tmp_path / "b.npz", views), border=2)
    assert [view for view, (psnr, _) in found.views.items() if psnr < np.inf] == [(0, 0), (2, 3)]
    assert found.notes[-1].endswith("put right")


def keep(folder, *places, has_report=True):
    """Removes other views from a folder that we wrote."""
    for path in folder.iterdir():
        if path.name not in [f"view_{v:02}_{u:02}.png" for v, u in places] and (
            path.suffix == ".png" or not has_report
        ):
            path.unlink()
    return folder


def write_truth(path, views, name):
    path.mkdir()
    for file, data in write_views(views, name).items():
        (path / file).write_bytes(data)
    return path


CROSS = [(0, 2), (2, 0), (2, 2), (2, 4), (4, 2)]
NAMES = {
    "from one": lambda v, u: f"view_{v + 1:02}_{u + 1:02}.png",
    "other": lambda v, u: f"lf_{v + 1}_{u + 1}.png",
    "columns first": lambda v, u: f"view_{u:02}_{v:02}.png",
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("places", [CROSS, [(2, 1)], [(0, 0), (0, 4), (4, 0), (4, 4)]], ids=["cross", "one", "corners"])
@pytest.mark.parametrize("has_report", [True, False])
def test_some_views_are_compared_by_their_places(tmp_path, name, places, has_report):
    views = make_layers(channels=3)
    if not has_report and len(places) == 4:
        places = places[:3]  # four corners may be a light field of their own
    some = keep(save(tmp_path / "some", views), *places, has_report=has_report)
    truth = write_truth(tmp_path / "truth", views, NAMES[name])  # the pictures show where columns come first
    for one, other in ((some, truth), (truth, some), (some, save(tmp_path / "truth.npz", views))):
        found = compare(one, other, border=2)
        assert list(found.views) == places
        assert found.mean.psnr == np.inf
    assert f"{len(places)} of 25 views of truth.npz are compared with those at the same place in some" in found.notes


def test_some_views_of_another_depth_sense(tmp_path):
    views = make_layers(channels=3)
    some = keep(save(tmp_path / "some", views[::-1, ::-1], "lenses"), (0, 1))
    found = compare(some, save(tmp_path / "truth.npz", views), border=2)
    assert found.views == {(4, 3): (np.inf, 1)}


def test_some_views_of_another_grid_or_size(tmp_path):
    views = make_layers(channels=3)
    some = keep(save(tmp_path / "some", views), (2, 2))
    with pytest.raises(ValueError, match=r"some: 5x5 views of 96x96 pixels, 3 channels, but .* has 3x3 views"):
        compare(some, save(tmp_path / "a.npz", views[1:4, 1:4]), border=2)
    with pytest.raises(ValueError, match=r"some: 5x5 views of 96x96 pixels, 3 channels, but .* 5x5 views of 48x96"):
        compare(some, save(tmp_path / "b.npz", views[:, :, :48]), border=2)
    other = keep(save(tmp_path / "other", views), (0, 0), (2, 3))
    with pytest.raises(ValueError, match=r"some: none of its views is in .*other; give the same"):
        compare(some, other, border=2)
    (some / "view_02_02.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(ValueError, match=r"some: view_02_02\.png: "):
        compare(some, save(tmp_path / "c.npz", views), border=2)


def test_names_decide_where_there_is_no_grid(tmp_path):
    views = make_layers(channels=3)
    some = keep(save(tmp_path / "some", views), (2, 2), (0, 2))
    truth = write_truth(tmp_path / "truth", views, "view_{:02}_{:02}.png".format)
    (truth / "view_03_01.png").unlink()
    found = compare(some, truth, border=2)
    assert list(found.pictures) == ["view_00_02.png", "view_02_02.png"]
    assert found.notes[-1] == (
        "truth isn't a whole grid of views: its names must count views from 0, as those of some do"
    )


def test_one_picture_against_a_light_field(tmp_path):
    views = make_layers(channels=3)
    picture = tmp_path / "c.png"
    picture.write_bytes(encode_png(views[2, 2]))
    with pytest.raises(
        ValueError, match=r"c\.png: one view, but .*a\.npz has 5x5; .*`ciir convert .*a\.npz -o FOLDER`"
    ):
        compare(picture, save(tmp_path / "a.npz", views), border=2)
    folder = save(tmp_path / "views", views)
    with pytest.raises(ValueError, match=r"give the same view as the truth, a picture in .*views$"):
        compare(picture, folder, border=2)
    assert compare(picture, keep(folder, (2, 2)), border=2).views == {(0, 0): (np.inf, 1)}


def test_identical_views_are_not_in_the_mean(tmp_path):
    views = make_views()
    other = views.copy()
    other[1, 1, 5:9] = 0
    other[2, 2, 5:8] = 0
    found = compare(save(tmp_path / "a.npz", other), save(tmp_path / "b.npz", views), border=2)
    expected = np.mean([found.views[view][0] for view in ((1, 1), (2, 2))])
    assert found.mean.psnr == pytest.approx(expected, abs=1e-4)
    assert found.mean.ssim == pytest.approx(np.mean([ssim for _, ssim in found.views.values()]), abs=1e-5)


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
        (views[:2], "2x4 views of 20x24 pixels, 3 channels, but .* size$"),
        (views[..., :1], "grey, but"),
        (views[:, :, :10], "3x4 views of 10x24 pixels.* size$"),
        (views[:, :, :19], "size, such as the upper left 19x24 pixels of the truth$"),
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
