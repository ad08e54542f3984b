from collections.abc import Callable, Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import InputError, InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import Limits
from ciir.renderer.readers import view_set
from ciir.renderer.writers.pictures import encode
from tests.support.paths import SHARED


def picture(v: int, u: int, *, channels: int = 3, dtype: type = np.uint8, suffix: str = ".png") -> bytes:
    """2x3 pixels that say which view they are."""
    pixels = np.full((2, 3, channels), 16 * v + u, dtype)
    return encode(pixels, suffix)


def read(files: Mapping[str, bytes], grid: tuple[int, int] | None = None) -> LightField:
    return view_set.read(files, name="set", grid=grid)


def assert_in_order(field: LightField, pixels_v: int, pixels_u: int) -> None:
    assert field.views.shape[:4] == (pixels_v, pixels_u, 2, 3)
    expected = 16 * np.arange(pixels_v)[:, None] + np.arange(pixels_u)
    assert np.array_equal(field.views[..., 0, 0, 0], expected)


def message(files: Mapping[str, bytes], error: type[InputError], grid: tuple[int, int] | None = None) -> str:
    with pytest.raises(error) as caught:
        read(files, grid)
    assert "\n" not in str(caught.value)
    return str(caught.value)


NAMES: dict[str, Callable[[int, int], str]] = {
    "ours": lambda v, u: f"view_{v:02}_{u:02}.png",
    "ours, in a folder": lambda v, u: f"out.1/view_{v:02}_{u:02}.png",
    "NTIRE": lambda v, u: f"Bikes/View_{v}_{u}.png",
    "bare": lambda v, u: f"{v}_{u}.png",
    "epinet, from 1": lambda v, u: f"NAME2_{v + 1:02}_{u + 1:02}.png",
    "scene": lambda v, u: f"my-scene_{v}_{u}.PNG",
    "Stanford": lambda v, u: f"out_{v:02}_{u:02}_-{381 + u}.909271_{1103 - v}.376221.png",
    "Stanford, closed": lambda v, u: f"out_{v:02}_{u:02}_{381 + u}.9_{1103 - v}.3_.png",
    "Stanford, focal length": lambda v, u: f"out_{v:02}_{u:02}_381.9_1103.3_50.0_36.0.png",
}


@pytest.mark.parametrize("style", NAMES)
@pytest.mark.parametrize("grid", [None, (3, 12)])
def test_row_and_column_in_names(style: str, grid: tuple[int, int] | None) -> None:
    files = {NAMES[style](v, u): picture(v, u) for u in range(12) for v in range(3)}
    assert_in_order(read(files, grid), 3, 12)


@pytest.mark.parametrize("first", [0, 1])
def test_hci_cameras_are_row_major(first: int) -> None:
    files = {f"input_Cam{first + 4 * v + u:03}.png": picture(v, u) for u in range(4) for v in range(4)}
    assert_in_order(read(files), 4, 4)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(pixels_v=st.integers(1, 4), pixels_u=st.integers(2, 13), seed=st.randoms(use_true_random=False))
def test_without_places_natural_order_fills_the_grid(pixels_v: int, pixels_u: int, seed: object) -> None:
    files = [(f"frame{pixels_u * v + u}.png", picture(v, u)) for u in range(pixels_u) for v in range(pixels_v)]
    seed.shuffle(files)
    assert_in_order(read(dict(files), (pixels_v, pixels_u)), pixels_v, pixels_u)


def test_without_places_or_grid_a_square_is_taken() -> None:
    files = {f"IMG{9 + 3 * v + u}.png": picture(v, u) for u in range(3) for v in range(3)}
    assert_in_order(read(files), 3, 3)
    del files["IMG11.png"]
    assert "8 pictures" in message(files, InvalidOption)
    assert "give pixels" in message(files, InvalidOption)


@pytest.mark.parametrize("name", ["a.png", "view_07_07.png"])
def test_one_picture_is_one_view(name: str) -> None:
    assert read({name: picture(0, 0)}).views.shape == (1, 1, 2, 3, 3)


def test_side_files_are_left_out_and_others_are_not() -> None:
    files = {"0_0.png": picture(0, 0), "0_1.png": picture(0, 1)}
    beside = dict.fromkeys(("report.json", ".DS_Store", "__MACOSX/._0_0.png", "LICENSE", "a/readme.TXT"), b"?")
    assert_in_order(read(files | beside), 1, 2)
    assert "clip.mp4 is not a picture" in message(files | {"clip.mp4": b"?"}, UnsupportedType)
    assert "0_2.bmp is not a picture" in message(files | {"0_2.bmp": b"?"}, UnsupportedType)


def test_a_folder_without_pictures() -> None:
    for files in ({}, {"notes.txt": b"hello"}):
        assert "no pictures" in message(files, Unreadable)


def test_the_first_missing_view_is_named() -> None:
    files = {f"view_{v}_{u}.png": picture(v, u) for v in range(3) for u in range(3)}
    del files["view_1_2.png"]
    assert "no view (1, 2)" in message(files, InvalidOption)
    assert "no view (1, 1)" in message({"a_1_2.png": b"", "a_2_1.png": b"", "a_2_2.png": b""}, InvalidOption)
    assert "no view (0, 0)" in message({"a_0_1.png": b"", "a_1_0.png": b"", "a_1_1.png": b""}, InvalidOption)


def test_a_part_of_a_larger_set_keeps_its_names() -> None:
    files = {f"view_{v}_{u}.png": picture(v - 6, u - 3) for v in range(6, 9) for u in range(3, 7)}
    found = read(files)
    assert_in_order(found, 3, 4)
    assert found.notes == (
        "the views are named from (6, 3): they are taken as a part of a larger set, and counted from (0, 0) here",
    )
    assert "(6, 3) to (8, 6) (row, column), but no view (7, 4)" in message(
        {name: data for name, data in files.items() if name != "view_7_4.png"}, InvalidOption
    )


def test_a_wild_number_in_a_name_is_a_missing_view() -> None:
    assert "no view (1, 2)" in message({"a_1_1.png": b"", "a_999999999_999999999.png": b""}, InvalidOption)
    assert "no view (5, 6)" in message({"a_5_5.png": b"", "a_999999999_999999999.png": b""}, InvalidOption)


def test_two_files_for_one_view() -> None:
    files = {"a/view_0_0.png": b"", "b/view_0_0.png": b""}
    assert "a/view_0_0.png and b/view_0_0.png are both view (0, 0)" in message(files, InvalidOption)


def test_an_unnamed_picture_among_named_views() -> None:
    files = {f"view_{v}_{u}.png": b"" for v in range(2) for u in range(2)} | {"mask.png": b""}
    assert "mask.png is not" in message(files, InvalidOption)
    cameras = {f"input_Cam{i:03}.png": b"" for i in range(8)} | {"mask.png": b""}
    assert "mask.png is not named input_CamNNN" in message(cameras, InvalidOption)


def test_a_missing_camera() -> None:
    cameras = {f"input_Cam{i:03}.png": b"" for i in (0, 1, 3, 4)}
    assert "input_Cam002 is missing before input_Cam003.png" in message(cameras, InvalidOption)


def test_a_grid_that_does_not_fit() -> None:
    named = {f"view_{v}_{u}.png": b"" for v in range(2) for u in range(3)}
    assert "pixels: 3x2 is not the 2x3 grid" in message(named, InvalidOption, (3, 2))
    plain = {f"frame{i}.png": b"" for i in range(6)}
    assert "pixels: 2x2 asks for 4 views, but set holds 6 pictures" in message(plain, InvalidOption, (2, 2))
    assert "pixels: 2x2 asks for 4 views, but set holds 1 pictures" in message({"a.png": b""}, InvalidOption, (2, 2))


@pytest.mark.parametrize(
    ("odd", "expected"),
    [
        (encode(np.zeros((3, 3, 3), np.uint8), ".png"), "3x3 pixels of 3 x 8 bit"),
        (encode(np.zeros((2, 3, 1), np.uint8), ".png"), "2x3 pixels of 1 x 8 bit"),
        (encode(np.zeros((2, 3, 3), np.uint16), ".png"), "2x3 pixels of 3 x 16 bit"),
    ],
)
def test_the_picture_that_differs_is_named(odd: bytes, expected: str) -> None:
    files = {f"{v}_{u}.png": picture(v, u) for v in range(3) for u in range(3)} | {"1_1.png": odd}
    assert message(files, Unreadable).startswith(f"set: 1_1.png is {expected} but 0_0.png is 2x3 pixels of 3 x 8 bit; ")


def test_the_corrupt_picture_is_named() -> None:
    files = {f"{v}_{u}.png": picture(v, u) for v in range(3) for u in range(3)}
    files["1_2.png"] = files["1_2.png"][:-20]
    assert message(files, Unreadable).startswith("1_2.png: ")


def test_hostile_names_stay_on_one_line() -> None:
    plain = picture(0, 0)
    assert "a?b.bmp" in message({"a\nb.bmp": b""}, UnsupportedType)
    assert message({"a\n0_0.png": b"", "0_1.png": plain}, UnsupportedType).startswith("a?0_0.png: ")
    assert len(message({"9" * 5000 + "_0.png": plain, "0_1.png": plain}, InvalidOption)) < 400


def test_too_many_bytes_in_all() -> None:
    files = {f"{v}_{u}.png": picture(v, u) for v in range(3) for u in range(3)}
    assert view_set.read(files, name="set", grid=None, limits=Limits(set_bytes=162)).views.size == 3 * 54
    with pytest.raises(
        TooLarge, match=r"9 views of 2x3 pixels of 3 x 8 bit come to 162 bytes; at most 161 are read; give fewer"
    ):
        view_set.read(files, name="set", grid=None, limits=Limits(set_bytes=161))


def test_too_many_views_and_too_large_ones_are_not_decoded() -> None:
    files = {f"0_{u}.png": picture(0, u) for u in range(3)}
    with pytest.raises(TooLarge, match="3 pictures; at most 2 views are read"):
        view_set.read(files, name="set", grid=None, limits=Limits(views=2))
    with pytest.raises(TooLarge, match=r"0_0\.png: 2x3 pixels .* over the limit of 5 in all"):
        view_set.read(files, name="set", grid=None, limits=Limits(pixels=5))


@pytest.fixture(scope="module")
def knights() -> LightField:
    folder = SHARED / "data" / "lightfields" / "knights"
    if not folder.is_dir():
        pytest.skip("needs ../shared")
    return view_set.read({path.name: path.read_bytes() for path in folder.iterdir()}, name="knights", grid=None)


def test_knights_move_as_the_lens_array_does(knights: LightField) -> None:
    # d grows towards the wall at the top of the picture, and a point moves by -delta*d/pitch along x and along y from
    # one view to the next (design: Geometry). Slopes by least squares over the brightness of neighbouring views.
    grey = knights.views[7:10, 7:10].astype(float).mean(axis=-1)
    dy, dx = np.gradient(grey[1, 1])
    along_u, along_v = (grey[1, 2] - grey[1, 0]) / 2, (grey[2, 1] - grey[0, 1]) / 2
    wall, floor = np.s_[:64], np.s_[-32:]
    for change, slope in ((along_u, dx), (along_v, dy)):
        moved = [-(change * slope)[part].sum() / (slope**2)[part].sum() for part in (wall, floor)]
        assert moved[0] == pytest.approx(-1.0, abs=0.15)
        assert moved[1] == pytest.approx(0.8, abs=0.15)
