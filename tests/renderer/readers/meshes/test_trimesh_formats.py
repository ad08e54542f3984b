import struct
import time

import numpy as np
import pytest
import trimesh

from ciir.errors import TooLarge
from ciir.renderer.placement import Placement
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.meshes import UPRIGHT
from ciir.renderer.scene import Scene
from tests.support.meshes import FRONT, assert_refused, assert_refused_in_little_memory, find_area, read_mesh

SQUARE = b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
FACET = """facet normal 0 0 1
  outer loop
    vertex 0 0 0
    vertex 1.5e0 0 0
    VERTEX 1 1 0
  endloop
endfacet
"""
TRIANGLE = np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 1, 0], "<f4").tobytes() + b"\0\0"


def read_off(data: bytes) -> Scene:
    return read_mesh(".off", data)


@pytest.mark.parametrize(
    "head", [b"OFF\n4 1 0\n", b"OFF 4 1 0\n", b"# by hand\n\nOFF # here\n# and there\n4 1 0\n", b"OFF\r\n4 1\n"]
)
def test_off_square(head: bytes) -> None:
    assert read_off(head + SQUARE + b"4 0 1 2 3 255 0 0\n").triangles == 2


def test_off_polygons_of_several_lengths() -> None:
    (part,) = read_off(b"OFF\n4 2 0\n" + SQUARE + b"4 0 1 2 3\n3 0 1 3\n").parts
    corners = {frozenset(map(tuple, triangle)) for triangle in part.vertices[part.faces][:, :, :2].tolist()}
    assert len(part.faces) == 3
    assert corners == {
        frozenset([(0, 0), (1, 0), (1, 1)]),
        frozenset([(0, 0), (1, 1), (0, 1)]),
        frozenset([(0, 0), (1, 0), (0, 1)]),
    }


def test_an_off_polygon_that_is_not_convex_is_drawn_within_its_outline() -> None:
    scene = read_off(b"OFF\n4 1 0\n0 0 0\n4 0 0\n1 1 0\n0 4 0\n4 1 2 3 0\n")
    assert (find_area(scene), scene.notes) == (4, ())


@pytest.mark.parametrize("color", [b" 255 0 255", b" 255 0 255 255", b" 1.0 0.0 1.0 1.0"])
def test_off_face_colours(color: bytes) -> None:
    (part,) = read_off(b"OFF\n4 2 0\n" + SQUARE + b"4 0 1 2 3" + color + b"\n3 0 1 3 0 0 0\n").parts
    assert part.colors[part.faces].tolist() == pytest.approx(
        np.array([[[FRONT, 0, FRONT, 1]] * 3] * 2 + [[[0, 0, 0, 1]] * 3])
    )


@pytest.mark.parametrize("rest", [b"1 0 0\n3 0 1 3 7\n", b"6\n3 0 1 3 7\n", b"1 0 0\n3 0 1 3 red or blue\n"])
def test_face_colours_of_off_that_are_not_all_colours_are_noted(rest: bytes) -> None:
    scene = read_off(b"OFF\n4 2 0\n" + SQUARE + b"4 0 1 2 3 " + rest)
    assert scene.notes == ("colours that are not red, green and blue of every face are left out",)


@pytest.mark.parametrize("color", [b" 255 0 255 255", b" 1.0 0.0 1.0 1.0"])
def test_off_vertex_colours(color: bytes) -> None:
    (part,) = read_off(b"COFF\n4 1 0\n" + SQUARE.replace(b"\n", color + b"\n") + b"4 0 1 2 3\n").parts
    assert part.colors[0] == pytest.approx([FRONT, 0, FRONT, 1])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"OFF\n", "without counts"),
        (b"OFF\n4 1 0\n" + SQUARE, "cut short"),
        (b"OFF\n4 1 0\n0 0 0\n", "cut short"),
        (b"OFF\n-4 1 0\n" + SQUARE, "cut short"),
        (b"OFF\n999999999999 1 0\n" + SQUARE, "cut short"),
        (b"OFF\n4 1 0\n" + SQUARE + b"4 0 1 2\n", "fewer corners"),
        (b"OFF\n4 1 0\n" + SQUARE + b"3 0 1 4\n", "a face names vertex"),
        (b"OFF\n4 1 0\n" + SQUARE + b"3 0 1 -1\n", "a face names vertex"),
        (b"OFF\n4 1 0\n" + SQUARE + b"-3 0 1 2\n", "fewer corners"),
        (b"OFF\n4 1 0\n" + SQUARE.replace(b"1 1 0", b"1 x 0") + b"3 0 1 2\n", "can be read"),
        (b"OFF\n4 1 0\n" + SQUARE.replace(b"1 1 0", b"1 1") + b"3 0 1 2\n", "fewer than three numbers"),
        (b"OFF\n4 0 0\n" + SQUARE, "no triangles"),
        (b"OFF\n0 0 0\n", "no triangles"),
    ],
)
def test_malformed_off(data: bytes, message: str) -> None:
    assert_refused(".off", data, message)


def test_one_long_number_does_not_widen_all_the_others() -> None:
    text = b"OFF\n1001 1 0\n" + SQUARE * 250 + b"0 0 " + b"9" * 50_000 + b"\n3 0 1 1000\n"
    assert_refused_in_little_memory(".off", text)
    text = b"solid\n" + FACET.encode() * 500 + b"facet vertex 0 0 " + b"9" * 50_000 + b" endfacet\nendsolid"
    assert_refused_in_little_memory(".stl", text)


def test_off_counts_are_checked_before_lines_are_parsed() -> None:
    for data in (b"OFF\n4 0 0\n" + b"x\n" * 4, b"OFF\n0 2 0\n" + b"x\n" * 2, b"OFF\n1 1 0\n0 0 0\n4 0 0 0 0\n"):
        with pytest.raises(TooLarge, match="at most 1 and 3 are read"):
            read_mesh(".off", data, triangles=1)


def read_stl(data: bytes) -> Scene:
    return read_mesh(".stl", data)


def binary(triangles: bytes, count: int, text: bytes = b"") -> bytes:
    return text.ljust(80, b"\0") + struct.pack("<I", count) + triangles


def test_ascii_stl() -> None:
    scene = read_stl(f"solid my part\n{FACET}endsolid my part\nsolid 2\n{FACET}endsolid".encode())
    assert scene.triangles == 2
    assert scene.bounds().tolist() == [[0, 0, 0], [1.5, 1, 0]]


@pytest.mark.parametrize("text", [b"", b"solid by a careless writer"])
def test_binary_stl(text: bytes) -> None:
    scene = read_stl(binary(TRIANGLE * 3, 3, text))
    assert scene.triangles == 3
    assert scene.bounds().tolist() == [[0, 0, 0], [1, 1, 0]]


@pytest.mark.parametrize(("text", "bits"), [(b"COLOR=\xff\0\0\xff", b"\0\0"), (b"", b"\x1f\x80"), (b"", b"\x1f\x7f")])
def test_colours_of_stl_are_noted(text: bytes, bits: bytes) -> None:
    scene = read_stl(binary(TRIANGLE + TRIANGLE[:-2] + bits + b"\xff" * 50, 2, text))
    note = "the colours of an STL are left out; export it as PLY, OBJ or GLB"
    assert scene.notes == (*((note,) if text or bits[1] & 0x80 else ()), UPRIGHT)


@pytest.mark.parametrize(
    ("name", "up", "is_noted"), [("a.stl", "y", True), ("a.stl", "z", False), ("a.off", "y", False)]
)
def test_an_stl_with_y_up_is_noted(name: str, up: str, is_noted: bool) -> None:
    data = b"OFF\n4 1 0\n" + SQUARE + b"4 0 1 2 3\n" if name == "a.off" else binary(TRIANGLE, 1)
    scene = read(Bundle(name, name, {name: data}), Layout(), Placement(up=up))
    assert (UPRIGHT in scene.notes) == is_noted


@pytest.mark.parametrize("text", [b"", b"solid by a careless writer".ljust(80)])
def test_stl_data_after_the_last_triangle_is_ignored(text: bytes) -> None:
    assert read_stl(binary(TRIANGLE + b"a writer's own data", 1, text)).triangles == 1


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_stl_that_trimesh_writes_is_smooth_again(kind: str) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    data = mesh.export(file_type=kind)
    (part,) = read_stl(data if isinstance(data, bytes) else data.encode()).parts
    assert len(part.faces) == len(mesh.faces)
    positions, index = np.unique(part.vertices.round(5), axis=0, return_inverse=True)
    light = [np.ptp(part.colors[index == i, 0]) for i in range(len(positions))]
    assert max(light) < 1e-3  # one light at each position: no facets


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (binary(TRIANGLE, 2), "2 triangles in 134 bytes: cut short"),
        (binary(TRIANGLE[:-1], 1), "cut short"),
        (b"short", "cut short"),
        (binary(b"", 0), "no triangles"),
        (binary(TRIANGLE, 2**32 - 1), "cut short"),
        (binary(TRIANGLE[:12] + b"\xff" * 36 + b"\0\0", 1), "NaN or infinite"),
        (binary(bytes(50), 1), "zero area"),
        (f"solid\n{FACET}".encode(), "cut short"),
        (f"solid\n{FACET}{FACET[:90]}endsolid".encode(), "cut short"),
        (f"solid\n{FACET.replace('1.5e0', 'x')}endsolid".encode(), "can be read"),
        (b"solid empty\nendsolid empty\n", "no triangles"),
    ],
)
def test_malformed_stl(data: bytes, message: str) -> None:
    assert_refused(".stl", data, message)


def test_stl_of_many_solids_takes_time_in_proportion() -> None:
    begun = time.process_time()
    assert read_stl(f"solid\n{FACET}endsolid\n".encode() * 20_000).triangles == 20_000
    assert time.process_time() - begun < 10  # solid by solid it took 90 s


def test_stl_keywords_in_the_name_of_a_solid() -> None:
    text = f"solid a vertex 7 of a facet normal\n{FACET}endsolid a vertex\nsolid endsolid\n{FACET}endsolid".encode()
    assert read_stl(text).triangles == 2
