import tracemalloc

import numpy as np
import pytest
import trimesh

from ciir.errors import InputError, TooLarge
from ciir.renderer.limits import Limits
from ciir.renderer.readers import meshes
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.registry import SUFFIXES
from ciir.renderer.scene import Scene
from ciir.renderer.shading import shade

SQUARE = b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
FRONT = float(shade(np.array([[0.0, 0, 1]]))[0])


def read(data: bytes) -> Scene:
    return meshes.read(Bundle("a.off", "a.off", {"a.off": data}), SUFFIXES[".off"])


@pytest.mark.parametrize(
    "head", [b"OFF\n4 1 0\n", b"OFF 4 1 0\n", b"# by hand\n\nOFF # here\n# and there\n4 1 0\n", b"OFF\r\n4 1\n"]
)
def test_a_square(head: bytes) -> None:
    assert read(head + SQUARE + b"4 0 1 2 3 255 0 0\n").triangles == 2


def test_polygons_of_several_lengths_keep_their_order() -> None:
    (part,) = read(b"OFF\n4 2 0\n" + SQUARE + b"4 0 1 2 3\n3 0 1 3\n").parts
    assert part.vertices[part.faces][2].tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize("color", [b" 255 0 255 255", b" 1.0 0.0 1.0 1.0"])
def test_vertex_colours(color: bytes) -> None:
    (part,) = read(b"COFF\n4 1 0\n" + SQUARE.replace(b"\n", color + b"\n") + b"4 0 1 2 3\n").parts
    assert part.colors[0] == pytest.approx([FRONT, 0, FRONT, 1])


def test_what_trimesh_writes() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    scene = read(mesh.export(file_type="off").encode())
    assert scene.triangles == len(mesh.faces)
    assert scene.bounds() == pytest.approx(mesh.bounds, abs=1e-6)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"OFF\n", "can be read"),
        (b"OFF\n4 1 0\n" + SQUARE, "cut short"),
        (b"OFF\n4 1 0\n0 0 0\n", "cut short"),
        (b"OFF\n-4 1 0\n" + SQUARE, "cut short"),
        (b"OFF\n999999999999 1 0\n" + SQUARE, "cut short"),
        (b"OFF\n4 1 0\n" + SQUARE + b"4 0 1 2\n", "fewer corners"),
        (b"OFF\n4 1 0\n" + SQUARE + b"3 0 1 4\n", "names vertex 4"),
        (b"OFF\n4 1 0\n" + SQUARE + b"3 0 1 -1\n", "names vertex -1"),
        (b"OFF\n4 1 0\n" + SQUARE + b"-3 0 1 2\n", "fewer corners"),
        (b"OFF\n4 1 0\n" + SQUARE.replace(b"1 1 0", b"1 x 0") + b"3 0 1 2\n", "can be read"),
        (b"OFF\n4 1 0\n" + SQUARE.replace(b"1 1 0", b"1 1") + b"3 0 1 2\n", "can be read"),
        (b"OFF\n4 0 0\n" + SQUARE, "no triangles"),
        (b"OFF\n0 0 0\n", "no triangles"),
    ],
)
def test_malformed_files(data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read(data)
    assert "\n" not in str(caught.value)


def test_one_long_number_does_not_widen_all_the_others() -> None:
    tracemalloc.start()
    with pytest.raises(InputError):
        read(b"OFF\n1001 1 0\n" + SQUARE * 250 + b"0 0 " + b"9" * 50_000 + b"\n3 0 1 1000\n")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20_000_000


def test_counts_are_checked_before_lines_are_parsed() -> None:
    for data in (b"OFF\n4 0 0\n" + b"x\n" * 4, b"OFF\n0 2 0\n" + b"x\n" * 2, b"OFF\n1 1 0\n0 0 0\n4 0 0 0 0\n"):
        with pytest.raises(TooLarge, match="at most 1 and 3 are read"):
            meshes.read(Bundle("a.off", "a.off", {"a.off": data}, Limits(triangles=1)), SUFFIXES[".off"])
