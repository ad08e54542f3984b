import unicodedata
from dataclasses import replace

import numpy as np
import pytest

from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers.bundle import Folder
from ciir.renderer.readers.meshes import texture_files
from ciir.renderer.readers.meshes.texture_files import MOST_WORK, Resolver, to_rgba8
from ciir.renderer.writers.pictures import encode_png


def test_pixels_of_every_kind_become_rgba() -> None:
    grey = np.array([[[7]]], np.uint8)
    assert to_rgba8(grey, opaque=False).tolist() == [[[7, 7, 7, 255]]]
    assert to_rgba8(np.array([[[7, 9]]], np.uint8), opaque=False).tolist() == [[[7, 7, 7, 9]]]
    assert to_rgba8(np.array([[[1, 2, 3]]], np.uint8), opaque=False).tolist() == [[[1, 2, 3, 255]]]
    assert to_rgba8(np.array([[[1, 2, 3, 4]]], np.uint8), opaque=False).tolist() == [[[1, 2, 3, 4]]]
    assert to_rgba8(np.array([[[1, 2, 3, 4]]], np.uint8), opaque=True).tolist() == [[[1, 2, 3, 255]]]
    deep = np.array([[[0, 128, 129, 32896, 65535]]], np.uint16)[:, :, [0, 2, 3]]
    assert to_rgba8(deep, opaque=True).tolist() == [[[0, 1, 128, 255]]]


def test_a_texture_is_made_once_for_each_wrap() -> None:
    resolver = Resolver({"x.png": encode_png(np.zeros((1, 1, 3), np.uint8))}, "a.obj")
    first = resolver.load_texture("x.png", opaque=True)
    assert resolver.load_texture("x.png", opaque=True) is first
    clamped = resolver.load_texture("x.png", opaque=True, wrap_u="clamp")
    assert clamped is not first
    assert clamped.pixels is first.pixels


def test_names_are_relative_to_the_mesh_and_stay_within() -> None:
    resolver = Resolver({"m/x.mtl": b"1", "y.mtl": b"2"}, "m/a.obj")
    assert resolver.find_or_note("x.mtl", "file") == b"1"
    assert resolver.find_or_note("../y.mtl", "file") == b"2"
    assert resolver.find_or_note(r"C:\work\x.mtl", "file") == b"1"  # by its name alone, beside the mesh
    assert resolver.notes == []
    assert resolver.find_or_note("z.mtl", "file") is None
    resolver.find_or_note("../../z.mtl", "file")
    resolver.find_or_note("z.mtl", "file")
    assert len(resolver.notes) == 2


def test_the_only_file_of_a_name_is_found_in_any_folder_and_case() -> None:
    resolver = Resolver({"source/a.obj": b"", "textures/Skin.PNG": b"1", "other/skin.jpg": b"2"}, "source/a.obj")
    for name in ("skin.png", "tex/SKIN.png", r"C:\work\skin.png", "../../skin.png"):
        assert resolver.find_or_note(name, "texture") == b"1"
    assert resolver.notes[0] == "skin.png is missing; textures/Skin.PNG, the only file of that name, is used"


@pytest.mark.parametrize("stored", ["NFC", "NFD"])
@pytest.mark.parametrize("named", ["NFC", "NFD"])
def test_names_with_accents_are_found_however_they_are_stored(named: str, stored: str) -> None:
    key = unicodedata.normalize(stored, "m\xfcll/K\xf6rper.png")
    name = unicodedata.normalize(named, "m\xfcll/K\xf6rper.png")
    resolver = Resolver({"a.obj": b"", key: b"1", "other/" + key: b"2"}, "a.obj")
    assert (resolver.find(name), resolver.notes, resolver.used) == (b"1", [], {key})
    resolver = Resolver({"a.obj": b"", key: b"1"}, "a.obj")
    assert resolver.find(name.upper().replace("/", "s/")) == b"1"
    assert len(resolver.notes) == 1


def test_a_name_that_two_files_have_is_missing() -> None:
    resolver = Resolver({"a.obj": b"", "one/skin.png": b"1", "two/SKIN.png": b"2"}, "a.obj")
    assert resolver.find_or_note("skin.png", "texture") is None
    assert resolver.notes == [
        "texture skin.png is missing and is left out; put it next to the mesh, or give a zip that holds both"
    ]


def test_the_first_tile_is_taken_of_a_texture_in_tiles() -> None:
    resolver = Resolver({"a.obj": b"", "t/wood.1001.png": b"1", "t/wood.1002.png": b"2"}, "a.obj")
    assert resolver.find_or_note("t/wood.<UDIM>.png", "texture") == b"1"
    assert resolver.find_or_note("oak.<UDIM>.png", "texture") is None
    assert resolver.find_or_note("t/wood.1002.png", "texture") == b"2"
    assert resolver.notes == [
        "texture t/wood.<UDIM>.png: only tile 1001 is drawn, on all faces; bake one picture",
        "texture oak.1001.png is missing and is left out; put it next to the mesh, or give a zip that holds both",
    ]


def test_too_many_files_beside_a_mesh_are_not_searched(tmp_path) -> None:
    for number in range(5):
        (tmp_path / f"{number}.txt").touch()
    (tmp_path / "Skin.png").write_bytes(b"1")
    folder = Folder(tmp_path, replace(DEFAULT_LIMITS, files=4))
    assert Resolver(folder, "a.obj").find("skin.png") is None
    assert Resolver(Folder(tmp_path, DEFAULT_LIMITS), "a.obj").find("skin.png") == b"1"


def corrupt(height: int, width: int) -> bytes:
    data = encode_png(np.zeros((height, width, 3), np.uint8))
    at = data.index(b"IDAT") + 6
    return data[:at] + bytes(4) + data[at + 4 :]


def test_a_corrupt_texture_is_charged_before_it_is_decoded() -> None:
    files = {f"{i}.png": corrupt(20, 30) for i in range(MOST_WORK + 1)}
    resolver = Resolver(files, "a.obj", max_pixels=700)
    assert all(resolver.load_texture(name, opaque=True) is None for name in files)
    assert "0.png: damaged or cut off (while the PNG picture was decoded); send" in resolver.notes[0]
    assert (
        "20x30 pixels; 396 are left of the 2,800 that are decoded for all textures; scale them down"
        in resolver.notes[MOST_WORK]
    )


def test_textures_are_scaled_down_to_what_is_left() -> None:
    data = encode_png(np.full((40, 60, 3), (10, 20, 30), np.uint8))
    resolver = Resolver({f"{i}.png": data for i in range(9)}, "a.obj", max_pixels=2400)
    made = [resolver.load_texture(f"{i}.png", opaque=True) for i in range(9)]
    sizes = [texture.pixels.shape[:2] for texture in made if texture]
    assert sizes == [(20, 30), (20, 30), (20, 30), (14, 20)]
    assert sum(height * width for height, width in sizes) <= 2400
    assert all((texture.pixels == (10, 20, 30, 255)).all() for texture in made if texture)
    assert resolver.notes[0] == (
        "texture 0.png is scaled down from 40x60 to 20x30 pixels: each may have half of what is left of 2,400 for all"
    )
    assert resolver.notes[4:] == ["textures over 2,400 pixels in all are left out; scale them down"]


def test_a_texture_that_fits_stays_as_it_is() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (20, 30, 4), np.uint8)
    resolver = Resolver({"x.png": encode_png(pixels)}, "a.obj", max_pixels=1200)
    texture = resolver.load_texture("x.png", opaque=False)
    assert texture is not None
    assert np.array_equal(texture.pixels, pixels)
    assert resolver.notes == []


def test_a_texture_too_wide_to_draw_is_left_out_with_a_note() -> None:
    data = encode_png(np.zeros((1, texture_files.MAX_SIDE + 1, 1), np.uint8))
    fits = encode_png(np.zeros((texture_files.MAX_SIDE, 1, 1), np.uint8))
    resolver = Resolver({"x.png": data, "y.png": fits}, "a.obj")
    assert resolver.load_texture("x.png", opaque=True) is None
    assert resolver.load_texture("y.png", opaque=True) is not None
    assert resolver.notes == [
        "texture x.png is left out: 1x16385 pixels; at most 16,384 along a side are drawn; scale it down"
    ]


def test_notes_have_a_limit() -> None:
    resolver = Resolver({}, "a.obj")
    for i in range(2 * texture_files.MAX_NOTES):
        resolver.add_note(f"{i}")
    assert len(resolver.notes) == texture_files.MAX_NOTES + 1
    assert "the rest are not listed" in resolver.notes[-1]
