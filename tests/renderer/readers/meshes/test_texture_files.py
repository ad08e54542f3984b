import numpy as np

from ciir.renderer.readers.meshes import texture_files
from ciir.renderer.readers.meshes.texture_files import Resolver, to_rgba8
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
    assert resolver.find_or_note(r"C:\work\y.mtl", "file") is None
    assert resolver.find_or_note("../../y.mtl", "file") is None
    assert resolver.find_or_note("z.mtl", "file") is None
    resolver.find_or_note("z.mtl", "file")
    assert len(resolver.notes) == 3


def corrupt(height: int, width: int) -> bytes:
    data = encode_png(np.zeros((height, width, 3), np.uint8))
    at = data.index(b"IDAT") + 6
    return data[:at] + bytes(4) + data[at + 4 :]


def test_a_corrupt_texture_is_charged_before_it_is_decoded() -> None:
    files = {f"{i}.png": corrupt(20, 30) for i in range(3)}
    resolver = Resolver(files, "a.obj", max_pixels=1000)
    assert all(resolver.load_texture(name, opaque=True) is None for name in files)
    assert "0.png: damaged or cut off (while the PNG picture was decoded); send" in resolver.notes[0]
    assert "20x30 pixels; 399 are left of the 1,000 for all textures; scale them down" in resolver.notes[1]


def test_a_texture_that_takes_all_that_there_is() -> None:
    data = encode_png(np.zeros((20, 30, 3), np.uint8))
    resolver = Resolver({"x.png": data, "y.png": data}, "a.obj", max_pixels=600)
    assert resolver.load_texture("x.png", opaque=True) is not None
    assert resolver.load_texture("y.png", opaque=True) is None
    assert resolver.notes == ["textures over 600 pixels in all are left out; scale them down"]


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
