import struct
import tracemalloc

import numpy as np
import pytest
import trimesh

from ciir.errors import InputError
from ciir.renderer.readers import meshes
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.registry import SUFFIXES
from ciir.renderer.scene import Scene

FACET = """facet normal 0 0 1
  outer loop
    vertex 0 0 0
    vertex 1.5e0 0 0
    VERTEX 1 1 0
  endloop
endfacet
"""
TRIANGLE = np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 1, 0], "<f4").tobytes() + b"\0\0"


def read(data: bytes) -> Scene:
    return meshes.read(Bundle("a.stl", "a.stl", {"a.stl": data}), SUFFIXES[".stl"])


def binary(triangles: bytes, count: int, text: bytes = b"") -> bytes:
    return text.ljust(80, b"\0") + struct.pack("<I", count) + triangles


def test_ascii() -> None:
    scene = read(f"solid my part\n{FACET}endsolid my part\nsolid 2\n{FACET}endsolid".encode())
    assert scene.triangles == 2
    assert scene.bounds().tolist() == [[0, 0, 0], [1.5, 1, 0]]


@pytest.mark.parametrize("text", [b"", b"solid by a careless writer"])
def test_binary(text: bytes) -> None:
    scene = read(binary(TRIANGLE * 3, 3, text))
    assert scene.triangles == 3
    assert scene.bounds().tolist() == [[0, 0, 0], [1, 1, 0]]


@pytest.mark.parametrize("text", [b"", b"solid by a careless writer".ljust(80)])
def test_what_follows_the_last_triangle_is_left_aside(text: bytes) -> None:
    assert read(binary(TRIANGLE + b"a writer's own data", 1, text)).triangles == 1


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_what_trimesh_writes_is_smooth_again(kind: str) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    data = mesh.export(file_type=kind)
    (part,) = read(data if isinstance(data, bytes) else data.encode()).parts
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
def test_malformed_files(data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read(data)
    assert "\n" not in str(caught.value)


def test_one_long_number_does_not_widen_all_the_others() -> None:
    tracemalloc.start()
    with pytest.raises(InputError):
        read(b"solid\n" + FACET.encode() * 500 + b"facet" + b" vertex 0 0 " + b"9" * 50_000 + b" endfacet\nendsolid")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20_000_000
