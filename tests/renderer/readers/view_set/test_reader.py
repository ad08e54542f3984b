import io
import json
import zipfile
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

import ciir
from ciir.errors import InputError, InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import Limits
from ciir.renderer.readers import pictures
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.view_set import reader as view_set
from ciir.renderer.writers.pictures import encode
from tests.support.paths import SHARED


def picture(v: int, u: int, *, channels: int = 3, dtype: type = np.uint8, suffix: str = ".png") -> bytes:
    """2x3 pixels that say which view they are."""
    pixels = np.full((2, 3, channels), 16 * v + u, dtype)
    return encode(pixels, suffix)


def read(files: Mapping[str, bytes], grid: tuple[int, int] | None = None) -> LightField:
    return read_layout(files, pixels=grid)


def read_layout(files: Mapping[str, bytes], **layout: object) -> LightField:
    return view_set.read(files, name="set", layout=Layout(**layout)).load()  # type: ignore[arg-type]


def assert_in_order(field: LightField, pixels_v: int, pixels_u: int) -> None:
    assert field.views.shape[:4] == (pixels_v, pixels_u, 2, 3)
    expected = 16 * np.arange(pixels_v)[:, None] + np.arange(pixels_u)
    assert np.array_equal(field.views[..., 0, 0, 0], expected)


def message(files: Mapping[str, bytes], error: type[InputError], grid: tuple[int, int] | None = None) -> str:
    with pytest.raises(error) as caught:
        read(files, grid)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@settings(max_examples=25)
@given(pixels_v=st.integers(1, 4), pixels_u=st.integers(2, 13), seed=st.randoms(use_true_random=False))
def test_without_places_natural_order_fills_the_grid(pixels_v: int, pixels_u: int, seed: object) -> None:
    files = [(f"frame{pixels_u * v + u}.png", picture(v, u)) for u in range(pixels_u) for v in range(pixels_v)]
    seed.shuffle(files)
    assert_in_order(read(dict(files), (pixels_v, pixels_u)), pixels_v, pixels_u)


def test_a_note_says_what_was_taken_as_row_and_column() -> None:
    files = {f"{v}_{u}.png": picture(v, u) for v in range(2) for u in range(3)}
    assert read(files).notes == (
        "views: 2x3, rows x columns: in 0_2.png 0 is the row and 2 the column; order columns takes them the other way",
    )
    columns = read_layout(files, order="columns")
    assert np.array_equal(columns.views, read(files).views.swapaxes(0, 1))
    assert columns.notes == (
        "views: 3x2, rows x columns: in 1_0.png 1 is the column and 0 the row; order rows takes them the other way",
    )


@pytest.mark.parametrize("name", ["a.png", "view_07_07.png"])
def test_one_picture_is_one_view(name: str) -> None:
    assert read({name: picture(0, 0)}).views.shape == (1, 1, 2, 3, 3)


def test_side_files_are_left_out_and_others_are_not() -> None:
    files = {"0_0.png": picture(0, 0), "0_1.png": picture(0, 1)}
    beside = dict.fromkeys(("report.json", ".DS_Store", "__MACOSX/._0_0.png", "LICENSE", "a/README.TXT", "d.exr"), b"?")
    assert_in_order(read(files | beside), 1, 2)
    assert "clip.mp4 is not a picture" in message(files | {"clip.mp4": b"?"}, UnsupportedType)
    assert "0_2.tga is not a picture" in message(files | {"0_2.tga": b"?"}, UnsupportedType)


def test_a_folder_without_pictures() -> None:
    for files in ({}, {"notes.txt": b"hello"}):
        assert "no pictures" in message(files, Unreadable)


def test_a_picture_with_another_name_is_left_out_with_a_note() -> None:
    files = {f"view_{v}_{u}.png": picture(v, u) for v in range(2) for u in range(2)}
    (note, naming) = read(files | {"mask.png": b""}).notes
    assert note == "mask.png left out, as the names are unlike those of the views"
    assert naming.startswith("views: 2x2")


@pytest.mark.parametrize("form", ["d{:+.3f}", "z{:.6g}", "z{:.6g}mm"])
def test_depth_planes_are_no_views(form):
    files = {f"planes/plane_{n:03d}_{form.format(z)}.png": picture(0, n) for n, z in enumerate((-1, 0, 0.125, 1e7))}
    said = message(files | {"planes/report.json": b"{}"}, UnsupportedType)
    assert said == "set: holds depth planes that ciir made, not views; give the light field that they were made from"


def test_the_depth_sense_of_our_own_views_is_in_their_report() -> None:
    files = {f"out/view_{v:02}_{u:02}.png": picture(v, u) for v in range(2) for u in range(2)}
    assert read(files).depth_sense == "cameras"
    for stated, expected in (("lenses", "lenses"), ("cameras", "cameras"), ("both", "cameras")):
        report = json.dumps({"lens_array": {"depth_sense": stated}}).encode()
        assert read(files | {"out/report.json": report}).depth_sense == expected
    for report in (b"[]", b"{", b"[" * 200_000, b"{}"):
        assert read(files | {"out/report.json": report}).depth_sense == "cameras"


def test_our_own_views_state_their_depth_sense_without_the_report(tmp_path):
    light_field = ciir.LightField(np.zeros((2, 3, 4, 5, 3), np.uint8))
    for sense in ("lenses", "cameras"):
        light_field.with_depth_sense(sense).save(tmp_path / f"{sense}.zip")
        with zipfile.ZipFile(tmp_path / f"{sense}.zip") as archive:
            copied = {name: archive.read(name) for name in archive.namelist() if name != "report.json"}
        assert read(copied).depth_sense == sense
        light_field.with_depth_sense(sense).save(tmp_path / sense)
        (tmp_path / sense / "report.json").unlink()
        assert ciir.open(tmp_path / sense).depth_sense == sense
    for path in (tmp_path / "lenses").iterdir():
        path.rename(path.with_name(path.name.replace("view", "mine")))
    assert ciir.open(tmp_path / "lenses").depth_sense == "lenses"
    report = json.dumps({"lens_array": {"depth_sense": "lenses"}})
    (tmp_path / "cameras" / "report.json").write_text(report)  # as edited by hand
    assert ciir.open(tmp_path / "cameras").depth_sense == "lenses"


def test_some_of_our_own_views_are_read_with_their_places() -> None:
    def report(**array: object) -> dict[str, bytes]:
        return {"out/report.json": json.dumps({"lens_array": {"depth_sense": "lenses"} | array}).encode()}

    corners = {f"out/view_{v:02}_{u:02}.png": picture(v, u) for v in (0, 2) for u in (0, 12)}
    found = view_set.read_some(corners | report(pixels_v=3, pixels_u=13), name="set")
    assert found is not None
    assert (found.places, found.grid, found.field.depth_sense) == (
        ((0, 0), (0, 12), (2, 0), (2, 12)),
        (3, 13),
        "lenses",
    )
    assert found.field.views[0, :, 0, 0, 0].tolist() == [0, 12, 32, 44]
    unknown = view_set.read_some(corners | report(pixels_v="3"), name="set")
    assert unknown is not None
    assert unknown.grid is None
    for others in (
        corners,  # nothing shows that we wrote them
        corners | report(pixels_v=2, pixels_u=2),
        corners | report() | {"out/a.png": picture(0, 0)},
        corners | report() | {"b/view_00_00.png": picture(0, 0)},
        {f"out/view_{v:02}_{u:02}.png": picture(v, u) for v in range(2) for u in range(3)} | report(),  # all
        report(),
    ):
        assert view_set.read_some(others, name="set") is None


class Starts(dict[str, bytes]):
    """Files that can't be read whole."""

    def read_start(self, key: str, length: int) -> bytes:
        return super().__getitem__(key)[:length]

    def __getitem__(self, key: str) -> bytes:
        raise AssertionError(key)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".webp"])
def test_another_size_is_refused_before_anything_is_decoded(suffix: str) -> None:
    files = {f"{v}_{u}{suffix}": picture(v, u, suffix=suffix) for v in range(3) for u in range(3)}
    odd = {f"2_1{suffix}": encode(np.zeros((3, 3, 3), np.uint8), suffix)}
    assert message(Starts(files | odd), Unreadable) == (
        f"set: 2_1{suffix} is 3x3 pixels but 0_0{suffix} is 2x3 pixels; make all views alike"
    )


def test_a_view_that_its_orientation_turns_has_the_size_of_the_others() -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    turned = io.BytesIO()
    Image.fromarray(np.full((3, 2, 3), 1, np.uint8)).save(turned, "JPEG", exif=exif)
    field = read({"0_0.jpg": picture(0, 0, suffix=".jpg"), "0_1.jpg": turned.getvalue()})
    assert field.views.shape == (1, 2, 2, 3, 3)


@pytest.mark.parametrize(
    ("odd", "expected"),
    [
        (encode(np.zeros((2, 3, 1), np.uint8), ".png"), "2x3 pixels of 1 x 8 bit"),
        (encode(np.zeros((2, 3, 3), np.uint16), ".png"), "2x3 pixels of 3 x 16 bit"),
    ],
)
def test_the_picture_that_differs_is_named(odd: bytes, expected: str) -> None:
    files = {f"{v}_{u}.png": picture(v, u) for v in range(3) for u in range(3)} | {"2_2.png": odd}
    assert message(files, Unreadable).startswith(f"set: 2_2.png is {expected} but 1_1.png is 2x3 pixels of 3 x 8 bit; ")


def test_the_corrupt_picture_is_named() -> None:
    files = {f"{v}_{u}.png": picture(v, u) for v in range(3) for u in range(3)}
    files["1_2.png"] = files["1_2.png"][:-20]
    assert message(files, Unreadable).startswith("1_2.png: ")


def test_hostile_names_stay_on_one_line() -> None:
    plain = picture(0, 0)
    assert "a?b.tga" in message({"a\nb.tga": b""}, UnsupportedType)
    two_kinds = dict.fromkeys(("0_0.png", "0_1.png", "a\n0_2.png", "a\n0_3.png"), plain)
    assert "(0_0.png, a?0_2.png)" in message(two_kinds, InvalidOption)
    assert len(message({"9" * 5000 + "_0.png": plain, "0_1.png": plain}, InvalidOption)) < 400


def test_too_many_bytes_in_all() -> None:
    files = {f"{v}_{u}.png": picture(v, u) for v in range(3) for u in range(3)}
    assert view_set.read(files, name="set", limits=Limits(set_bytes=162)).load().views.size == 3 * 54
    with pytest.raises(
        TooLarge, match=r"9 views of 2x3 pixels of 3 x 8 bit come to 162 bytes; at most 161 are read; give fewer"
    ):
        view_set.read(files, name="set", limits=Limits(set_bytes=161)).load()


def test_too_many_views_and_too_large_ones_are_not_decoded() -> None:
    files = {f"0_{u}.png": picture(0, u) for u in range(3)}
    with pytest.raises(TooLarge, match="3 pictures; at most 2 views are read"):
        view_set.read(files, name="set", limits=Limits(views=2))
    with pytest.raises(TooLarge, match=r"0_1\.png: 2x3 pixels .* over the limit of 5 in all"):
        view_set.read(files, name="set", limits=Limits(pixels=5))


CAPTURED = SHARED / "data" / "lightfields"
NEEDS_CAPTURED = pytest.mark.skipif(not CAPTURED.is_dir(), reason="needs the captured light fields")


def measure_shifts(light_field: LightField, part: tuple[slice, slice], step: int) -> tuple[float, float]:
    """By how many pixels content of `part` of the centre view moves to the right from one view to the next on the
    right, and down from one to the next below; from gradients, so for shifts of a few pixels.
    """
    v, u = (count // 2 for count in light_field.shape[:2])
    grey = light_field.views[..., :3].astype(float).mean(axis=-1)
    dy, dx = np.gradient(grey[v, u])
    along_u = (grey[v, u + step] - grey[v, u - step]) / (2 * step)
    along_v = (grey[v + step, u] - grey[v - step, u]) / (2 * step)
    right, down = (
        (change * slope)[part].sum() / (slope**2)[part].sum() for change, slope in ((along_u, dx), (along_v, dy))
    )
    return -right, -down


@NEEDS_CAPTURED
@pytest.mark.parametrize(
    ("folder", "pattern", "near", "far", "depth_sense"),
    [
        # The floor before the knights, and the wall behind them. X falls in the names as columns grow, and Y as rows
        # do: the cameras go to the left and up, so near content moves to the right and down.
        ("knights", "out_0[7-9]_0[7-9]_*.jpg", np.s_[-32:, :], np.s_[:64, :], "lenses"),
        # The dinosaur's foreleg, and the wall with its shrubs.
        ("lytro-2067", "*_0[3-7]_0[3-7].png", np.s_[260:380, 320:400], np.s_[20:150, 60:220], "cameras"),
    ],
)
def test_captured_light_fields_move_as_their_names_say(folder, pattern, near, far, depth_sense):
    light_field = inputs_read(folder, pattern)
    assert light_field.depth_sense == depth_sense
    sign = 1 if depth_sense == "lenses" else -1  # near content moves to the right and down, or to the left and up
    for nearer, farther in zip(measure_shifts(light_field, near, 1), measure_shifts(light_field, far, 1), strict=True):
        assert sign * (nearer - farther) > 0.1


def inputs_read(folder: str, pattern: str) -> LightField:
    files = {path.name: path.read_bytes() for path in sorted((CAPTURED / folder).glob(pattern))}
    return view_set.read(files, name=folder).load()


@NEEDS_CAPTURED
def test_columns_that_are_named_first_are_found_by_the_pictures() -> None:
    light_field = inputs_read("saii-5x5", "[1-3]_[1-3].png")
    assert light_field.depth_sense == "cameras"
    assert light_field.notes[0].startswith(
        "order: 3x3 views, rows x columns: in 1_3.png 1 is the column and 3 the row, "
    )
    decode = pictures.decode
    named = {
        (c, r): decode((CAPTURED / f"saii-5x5/{c}_{r}.png").read_bytes(), name="") for c in (1, 2, 3) for r in (1, 2, 3)
    }
    for v, u in np.ndindex(3, 3):
        assert np.array_equal(light_field.views[v, u], named[u + 1, v + 1])


@pytest.mark.parametrize("count", [4, 9, 16])
def test_numbered_pictures_may_be_one_row(tmp_path, count):
    """Of a camera rail: the note on the square that was taken names the option for a row."""
    for number in range(count):
        Image.new("RGB", (12, 10), (number, 0, 0)).save(tmp_path / f"shot{number:02d}.png")
    option = f"pixels 1x{count} takes them as one row"
    assert any(option in note for note in ciir.open(tmp_path).notes)
    row = ciir.open(tmp_path, pixels=(1, count))
    assert row.views.shape[:2] == (1, count)
    assert not any(option in note for note in row.notes)
