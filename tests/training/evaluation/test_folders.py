import zipfile

import numpy as np
import pytest

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")

from ciir.renderer.light_field import LightField
from ciir.renderer.writers.pictures import encode
from ciir.training.evaluation.results import compare

PICTURE = np.random.default_rng(0).integers(0, 200, (20, 24, 3), np.uint8)


def write(folder, pictures):
    folder.mkdir()
    for name, picture in pictures.items():
        (folder / name).write_bytes(encode(picture, f".{name.rsplit('.')[-1]}"))
    return folder


def test_pictures_of_equal_names_are_compared(tmp_path):
    """As `ciir upscale FOLDER` writes them: names stay, JPEGs become PNGs, and sizes differ."""
    truth = write(tmp_path / "hr", {"a.png": PICTURE, "b.tif": PICTURE[:18], "c.png": PICTURE, "d.png": PICTURE})
    found = write(tmp_path / "up", {"a.png": PICTURE, "b.png": PICTURE[:18] + np.uint8(9), "x.png": PICTURE})
    score = compare(found, truth, border=2)
    assert list(score.pictures) == ["a.png", "b.png"]
    assert score.pictures["a.png"][0] == np.inf
    assert 25 < score.pictures["b.png"][0] < 35
    (note,) = score.notes
    assert note.startswith("2 of 4 pictures of hr are compared with those of the same name in up; 2 have no partner, ")
    assert note.endswith("such as c.png; 1 more in up are left out")
    assert compare(truth, truth, border=2).notes == (
        "4 of 4 pictures of hr are compared with those of the same name in hr",
    )


VIEWS = [(0, 4), (4, 0), (4, 4), (4, 8), (8, 4)]


def name_views(views):
    return {f"view_{v:02}_{u:02}.png": np.roll(PICTURE, (v, u), (0, 1)) for v, u in views}


@pytest.mark.parametrize("views", [VIEWS, [(4, 4)], list(np.ndindex(9, 9))], ids=["cross", "one", "all"])
@pytest.mark.parametrize("true", [VIEWS, [(4, 4)]], ids=["cross", "one"])
def test_folders_of_some_views(tmp_path, views, true):
    truth, found = write(tmp_path / "t", name_views(true)), write(tmp_path / "r", name_views(views))
    score = compare(found, truth, border=2)
    assert score.mean.psnr == np.inf
    assert list(score.pictures) == sorted(name_views(true).keys() & name_views(views).keys())


def test_one_view_in_a_folder_and_a_picture(tmp_path):
    truth = write(tmp_path / "t", name_views([(4, 4)]))
    assert compare(truth / "view_04_04.png", truth, border=2).views == {(0, 0): (np.inf, 1)}


def test_a_folder_has_one_white_level(tmp_path):
    bright, dark = (np.full((20, 24, 3), level, np.uint16) for level in (1000, 20))
    truth = write(tmp_path / "t", {"a.png": bright, "b.png": dark})
    found = write(tmp_path / "r", {"a.png": bright + np.uint16(99), "b.png": dark * np.uint16(2)})
    score = compare(found, truth, border=2)
    assert score.notes[1].startswith(
        "white is level 1,023, because t uses 10 of 16 bits; samples of r above it, which count as white: 1,440"
    )
    assert score.pictures["b.png"][0] == pytest.approx(20 * np.log10(255 / (5 * 219 / 255)), abs=0.01)


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        ({"z.png": PICTURE}, r"r: no picture in it has the name of one in .*t; give folders"),
        ({"a.png": PICTURE[:18], "b.png": PICTURE}, r"r/a\.png: 18x24 pixels, 3 channels, but .*t/a\.png has 20x24"),
        ({"a.png": PICTURE, "a.tif": PICTURE}, r"r: a\.png and a\.tif have one name; remove one"),
    ],
)
def test_folders_that_cannot_be_compared(tmp_path, pictures, message):
    truth = write(tmp_path / "t", {"a.png": PICTURE, "b.png": PICTURE[:18]})
    with pytest.raises(ValueError, match=message):
        compare(write(tmp_path / "r", pictures), truth, border=2)


def test_a_corrupt_picture_of_a_pair(tmp_path):
    truth = write(tmp_path / "t", {"a.png": PICTURE, "b.png": PICTURE[:18]})
    found = write(tmp_path / "r", {"a.png": PICTURE})
    (found / "a.png").write_bytes((truth / "a.png").read_bytes()[:200])
    with pytest.raises(ValueError, match=r"r/a\.png: "):
        compare(found, truth, border=2)


def test_a_zip_of_a_folder_has_the_names_in_it(tmp_path):
    truth = write(tmp_path / "t", name_views(VIEWS))
    with zipfile.ZipFile(tmp_path / "r.zip", "w") as archive:
        for path in sorted(truth.iterdir())[:3]:
            archive.write(path, f"some/folder/{path.name}")
    assert compare(tmp_path / "r.zip", truth, border=2).mean.pictures == 3


def test_sets_of_different_depth_senses_are_not_compared_by_name(tmp_path):
    """Without reports, their places in a light field aren't known."""
    views = np.stack(list(name_views(np.ndindex(3, 3)).values())).reshape(3, 3, *PICTURE.shape)
    for sense in ("lenses", "cameras"):
        LightField(views).with_depth_sense(sense).save(tmp_path / sense)
        for name in ("view_00_01.png", "report.json"):
            (tmp_path / sense / name).unlink()
    with pytest.raises(ValueError, match=r"its views count cameras, those of .*/lenses lenses, so"):
        compare(tmp_path / "cameras", tmp_path / "lenses", border=2)
