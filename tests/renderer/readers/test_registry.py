import struct
import tracemalloc

import pytest

from ciir.errors import Unreadable, UnsupportedType
from ciir.renderer.readers.registry import (
    FORMATS,
    SUFFIXES,
    Format,
    identify,
)
from tests.support.paths import ROOT

BINARY_STL = b"solid by a careless writer".ljust(80) + struct.pack("<I", 1) + bytes(50)
CONTENTS = {
    "a.glb": (b"glTF\2\0\0\0", SUFFIXES[".glb"]),
    "a.vrm": (b"glTF\2\0\0\0", SUFFIXES[".glb"]),
    "a.gltf": (b'\xef\xbb\xbf {"asset": {"version": "2.0"}}', SUFFIXES[".gltf"]),
    "a.obj": (b"# made by hand\no thing\nv 0 0 0\n", SUFFIXES[".obj"]),
    "b.obj": (b"O THING\nV 0 0 0\n", SUFFIXES[".obj"]),
    "a.PLY": (b"ply\nformat ascii 1.0\n", SUFFIXES[".ply"]),
    "a.stl": (b"solid thing\nfacet normal 0 0 1\n", SUFFIXES[".stl"]),
    "b.stl": (BINARY_STL, SUFFIXES[".stl"]),
    "a.off": (b"# made by hand\nOFF\n3 1 0\n", SUFFIXES[".off"]),
    "a.png": (b"\x89PNG\r\n\x1a\n", SUFFIXES[".png"]),
    "a.jpeg": (b"\xff\xd8\xff\xe0", SUFFIXES[".jpg"]),
    "a.jpg": (b"\xff\xd8\xff\xe0", SUFFIXES[".jpg"]),
    "a.tiff": (b"MM\0*", SUFFIXES[".tif"]),
    "a.tif": (b"II*\0", SUFFIXES[".tif"]),
    "a.npy": (b"\x93NUMPY\1\0", SUFFIXES[".npy"]),
    "a.zip": (b"PK\5\6" + bytes(18), SUFFIXES[".zip"]),
}


@pytest.mark.parametrize("name", CONTENTS)
def test_name_and_content_agree(name: str) -> None:
    data, kind = CONTENTS[name]
    assert identify(name, data) is kind
    assert identify("no suffix", data) is kind


def test_every_format_is_in_the_docs() -> None:
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    for entry in FORMATS:
        assert f"| {entry.name} | {', '.join(f'`{suffix}`' for suffix in entry.suffixes)} |" in page


def test_a_suffix_of_another_format_is_refused_with_both_formats_named() -> None:
    with pytest.raises(
        UnsupportedType,
        match=r"duck\.glb: the suffix is that of GLB but the content is PNG; rename it to end with \.png",
    ):
        identify("duck.glb", CONTENTS["a.png"][0])


def test_a_text_file_is_refused() -> None:
    for name, message in (
        ("notes", "notes: text of no known format; give one of"),
        ("notes.obj", r"notes\.obj: the content is text, not OBJ; save it again"),
    ):
        with pytest.raises(UnsupportedType, match=message):
            identify(name, b"Dear all,\nthe mesh follows tomorrow.\n")


def test_what_matlab_and_octave_save_in_other_ways_is_to_be_saved_as_version_7() -> None:
    version_4 = struct.pack("<5i", 50, 2, 3, 0, 3) + b"LF\0" + bytes(6)
    for data in (version_4, b"# Created by Octave 8.4\n# name: LF\n# type: uint8 matrix\n"):
        with pytest.raises(UnsupportedType, match=r"a\.mat: the content is .*, not MAT; save it with -v7 or -v7\.3"):
            identify("a.mat", data)


def test_random_bytes_are_refused() -> None:
    for name, message in (("a", "binary data of no known format"), ("a.glb", "binary data, not GLB")):
        with pytest.raises(UnsupportedType, match=message):
            identify(name, bytes(range(256)))


def test_a_type_that_is_not_read_is_named() -> None:
    with pytest.raises(UnsupportedType, match=r"files of type \.doc are not read; give one of \.glb"):
        identify("a.doc", b"Dear all")


def test_meshes_that_are_not_read_are_to_be_exported() -> None:
    """Types of pictures and containers would be no help."""
    for name in ("a.FBX", "a.usdz", "folder/a.blend"):
        with pytest.raises(UnsupportedType, match="are not read; export it as GLB") as caught:
            identify(name, b"Kaydara FBX Binary  \0")
        assert ".obj" in str(caught.value)
        assert ".png" not in str(caught.value)


@pytest.mark.parametrize("name", ["duck.glb", "duck.png", "duck.obj", "duck.stl", "duck"])
def test_what_is_stored_in_place_of_a_file(name: str) -> None:
    for data in (b"<!DOCTYPE html>\n<html>", b"\xef\xbb\xbf\n<HTML lang=en>", b"<!-- a --> <!doctype html>"):
        with pytest.raises(UnsupportedType, match="this is a web page; download the file itself"):
            identify(name, data)
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 120484\n"
    with pytest.raises(UnsupportedType, match="this is a Git LFS pointer; download the file itself"):
        identify(name, pointer)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (b"  # one\n\t#two\r\n \n  COFF 3 1 0\n", SUFFIXES[".off"]),
        (b"#OFF\nv 0 0 0\n", SUFFIXES[".obj"]),
        (b"OFFER\nv 0 0 0\n", SUFFIXES[".obj"]),
        (b"x OFF\nv 0 0 0\n", SUFFIXES[".obj"]),
    ],
)
def test_off_is_the_first_word_that_is_no_comment(text: bytes, kind: Format) -> None:
    assert identify("a", text) is kind


def test_comments_without_end_take_no_memory() -> None:
    data = b"#\n" * 2_000_000 + b"OFF\n3 1 0\n"
    tracemalloc.start()
    assert identify("a.off", data) is SUFFIXES[".off"]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3 * len(data)  # two copies without the spaces before; an item for each comment would be 25 times that


def test_no_bytes_at_all() -> None:
    with pytest.raises(Unreadable, match="empty"):
        identify("a.obj", b"")


def test_a_binary_stl_that_is_cut_short_is_identified_by_suffix() -> None:
    assert identify("a.stl", BINARY_STL[:-7]) is SUFFIXES[".stl"]


@pytest.mark.parametrize(
    ("suffix", "data"),
    [
        (".exr", b"v/1\1\2\0\0\0"),
        (".svg", b'<svg xmlns="http://www.w3.org/2000/svg"/>'),
        (".pkl", b"\x80\4\x95\0\0\0"),
        (".ps", b"%!PS-Adobe-3.0\n"),
    ],
)
def test_kinds_that_are_never_read(suffix: str, data: bytes) -> None:
    for name in (f"a{suffix}", "a", "a.png", "a.glb"):
        with pytest.raises(UnsupportedType):
            identify(name, data)
