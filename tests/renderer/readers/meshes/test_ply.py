import struct

import numpy as np
import pytest

from ciir.errors import TooLarge
from ciir.renderer.scene import Scene
from ciir.renderer.surface import DEFAULT_COLOR
from ciir.renderer.writers.pictures import encode_png
from tests.support.meshes import FRONT, UP, assert_refused, assert_refused_in_little_memory, find_area, read_mesh

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
XYZ = "property float x\nproperty float y\nproperty float z\n"
FACE = "property list uchar int vertex_indices\n"
PICTURE = encode_png(np.zeros((2, 2, 3), np.uint8))


def header(form: str, vertex: str, faces: int, face: str = FACE, comment: str = "") -> bytes:
    text = f"ply\nformat {form} 1.0\n{comment}element vertex 4\n{vertex}element face {faces}\n{face}end_header\n"
    return text.encode()


def read(data: bytes) -> Scene:
    return read_mesh(".ply", data, {"x.png": PICTURE})


def ascii_square(
    vertex: str, rows: list[str], face: str = FACE, faces: str = "4 0 1 2 3\n", comment: str = ""
) -> bytes:
    count = faces.count("\n")
    return header("ascii", vertex, count, face, comment=comment) + ("\n".join(rows) + "\n" + faces).encode()


PLAIN_ROWS = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]


def test_a_polygon_that_is_not_convex_is_drawn_within_its_outline() -> None:
    scene = read(ascii_square(XYZ, ["0 0 0", "4 0 0", "1 1 0", "0 4 0"], faces="4 1 2 3 0\n"))
    assert (find_area(scene), scene.notes) == (4, ())


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("polygons", [[[0, 1, 2, 3]], [[0, 1, 2], [0, 2, 3]], [[0, 1, 2], [0, 1, 2, 3]]])
def test_binary_of_either_order_with_polygons_of_any_lengths(order: str, polygons: list[list[int]]) -> None:
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    data = header(form, XYZ, len(polygons)) + SQUARE.astype(order + "f4").tobytes()
    for polygon in polygons:
        data += struct.pack(f"{order}B{len(polygon)}i", len(polygon), *polygon)
    (part,) = read(data).parts
    expected = [[p[0], p[i], p[i + 1]] for p in polygons for i in range(1, len(p) - 1)]
    assert part.vertices[part.faces].tolist() == SQUARE[expected].tolist()
    assert part.colors[:, 0] == pytest.approx(DEFAULT_COLOR[0] * FRONT)


@pytest.mark.parametrize(
    "changes",
    [
        {b"\n": b"\r\n"},
        {b"format ascii 1.0\n": b"comment first\n\nformat ascii 1.0\n"},
        {b"element face": b"element edge 1\nproperty int a\nproperty int b\nelement face", b"\n4 0": b"\n0 1\n4 0"},
    ],
)
def test_ascii_as_other_programs_write_it(changes: dict[bytes, bytes]) -> None:
    text = ascii_square(XYZ, PLAIN_ROWS, comment="comment made by hand\nobj_info x\n")
    for old, new in changes.items():
        text = text.replace(old, new)
    assert read(text).triangles == 2


@pytest.mark.parametrize(("kind", "full"), [("uchar", 255), ("ushort", 65535), ("float", 1)])
def test_vertex_colours_of_every_type(kind: str, full: int) -> None:
    vertex = XYZ + "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    (part,) = read(ascii_square(vertex, [f"{row} {full} 0 {full}" for row in PLAIN_ROWS])).parts
    assert part.colors == pytest.approx(np.tile([FRONT, 0, FRONT, 1], (4, 1)))


@pytest.mark.parametrize(
    "names", [("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), tuple("rgb")]
)
@pytest.mark.parametrize("of_faces", [False, True])
def test_float_colours_in_levels_are_noted(of_faces: bool, names: tuple[str, str, str]) -> None:
    colour = "".join(f"property float {name}\n" for name in names)
    for levels, notes in (
        ("255 51 0", ("vertex colours above 1 are taken as levels from 0 to 255",)),
        ("1.0 0.2 0", ()),
        ("nan 0.2 0", None),
    ):
        if of_faces:
            data = ascii_square(XYZ, PLAIN_ROWS, FACE + colour, f"3 0 1 2 {levels}\n3 0 2 3 {levels}\n")
        else:
            data = ascii_square(XYZ + colour, [f"{row} {levels}" for row in PLAIN_ROWS])
        scene = read(data)
        red = 0 if notes is None else FRONT
        assert scene.parts[0].colors[0] == pytest.approx([red, 0.2 * FRONT, 0, 1])
        assert notes is None or scene.notes == notes


@pytest.mark.parametrize(("kind", "half"), [("uchar", "102"), ("float", "0.4"), ("float", "102.0")])
@pytest.mark.parametrize("name", ["a", "alpha"])
def test_colours_named_by_letters_have_an_alpha(name: str, kind: str, half: str) -> None:
    vertex = XYZ + "".join(f"property {kind} {channel}\n" for channel in ("r", "g", "b", name))
    (part,) = read(ascii_square(vertex, [f"{row} 0 0 0 {half}" for row in PLAIN_ROWS])).parts
    assert part.colors == pytest.approx(np.tile([0, 0, 0, 0.4], (4, 1)))


@pytest.mark.parametrize(("alpha", "expected"), [([51] * 4, [0.2] * 4), ([255] * 4, [1] * 4), ([0] * 4, [1] * 4)])
def test_alpha_of_vertices_is_see_through_unless_it_is_0_throughout(alpha: list[int], expected: list[float]) -> None:
    vertex = XYZ + "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "alpha"))
    rows = [f"{row} 255 0 0 {value}" for row, value in zip(PLAIN_ROWS, alpha, strict=True)]
    (part,) = read(ascii_square(vertex, rows)).parts
    assert part.colors[:, 3] == pytest.approx(expected)
    assert part.is_see_through == (expected[0] < 1)


def test_face_colours() -> None:
    face = FACE + "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    faces = "3 0 1 2 255 0 0\n3 0 2 3 0 0 255\n"
    (part,) = read(ascii_square(XYZ, PLAIN_ROWS, face, faces)).parts
    assert part.colors[part.faces][:, :, :3].tolist() == pytest.approx(
        np.array([[[FRONT, 0, 0]] * 3, [[0, 0, FRONT]] * 3])
    )


def test_normals_of_the_file_are_used() -> None:
    vertex = XYZ + "property float nx\nproperty float ny\nproperty float nz\n"
    (part,) = read(ascii_square(vertex, [f"{row} 0 1 0" for row in PLAIN_ROWS])).parts
    assert part.colors[:, 0] == pytest.approx(DEFAULT_COLOR[0] * UP)


def test_texture_coordinates_of_vertices_and_of_faces() -> None:
    comment = "comment TextureFile x.png\n"
    vertex = XYZ + "property float s\nproperty float t\n"
    rows = [f"{row} {row[:3]}" for row in PLAIN_ROWS]
    by_vertex = read(ascii_square(vertex, rows, comment=comment))
    face = FACE + "property list uchar float texcoord\n"
    faces = "3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0 0 1 1 0 1\n"
    by_face = read(ascii_square(XYZ, PLAIN_ROWS, face, faces, comment))
    for scene in (by_vertex, by_face):
        (part,) = scene.parts
        assert part.texture is not None
        assert np.array_equal(part.uv[part.faces], part.vertices[part.faces][:, :, :2])


TEXCOORD = FACE + "property list uchar float texcoord\n"
SEVERAL = "".join(f"comment TextureFile {name}\n" for name in ("x.png", "y z.png", "gone.png"))


@pytest.mark.parametrize("with_vertices", [True, False])
def test_several_textures(with_vertices: bool) -> None:
    rows, vertex, listed = PLAIN_ROWS, XYZ, ("6 0 0 1 0 1 1 ", "6 0 0 1 1 0 1 ")
    if with_vertices:
        rows, vertex, listed = (
            [f"{row} {row[:3]}" for row in rows],
            XYZ + "property float s\nproperty float t\n",
            ("", ""),
        )
    face = (FACE if with_vertices else TEXCOORD) + "property int texnumber\n"
    colour = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    data = ascii_square(vertex + colour, [f"{row} 255 0 0" for row in rows], face, "", SEVERAL)
    data = data.replace(b"face 0", b"face 5")
    data += f"3 0 1 2 {listed[0]}1\n3 0 2 3 {listed[1]}0\n".encode()
    data += b"".join(b"3 0 1 2 " + listed[0].encode() + number + b"\n" for number in (b"-1", b"2", b"3"))
    pictures = {"x.png": PICTURE, "y z.png": encode_png(np.full((2, 2, 3), 9, np.uint8))}
    scene = read_mesh(".ply", data, pictures)
    found = {None if part.texture is None else int(part.texture.pixels[0, 0, 0]): part for part in scene.parts}
    assert found[None].colors[0, :3] == pytest.approx([FRONT, 0, 0])
    assert [len(found[key].faces) for key in (None, 0, 9)] == [3, 1, 1]
    for key, corners in ((0, [0, 2, 3]), (9, [0, 1, 2])):
        part = found[key]
        assert part.vertices[part.faces].tolist() == [SQUARE[corners].tolist()]
        assert np.array_equal(part.uv[part.faces], part.vertices[part.faces][:, :, :2])
        assert part.colors[0, 0] == pytest.approx(FRONT)
    assert scene.notes == (
        "texture gone.png is missing and is left out; put it next to the mesh, or give a zip that holds both",
        "faces whose texture the header doesn't name are drawn without one",
    )


def test_faces_that_name_none_of_several_textures_have_the_first() -> None:
    vertex = XYZ + "property float s\nproperty float t\n"
    scene = read(ascii_square(vertex, [f"{row} {row[:3]}" for row in PLAIN_ROWS], comment=SEVERAL))
    assert scene.parts[0].texture is not None
    assert scene.notes == ("x.png is used for all faces, as none names one of 3 textures",)


def test_a_face_of_one_of_several_textures_that_names_no_vertex_is_refused() -> None:
    vertex = XYZ + "property float s\nproperty float t\n"
    rows = [f"{row} {row[:3]}" for row in PLAIN_ROWS]
    face = FACE + "property int texnumber\n"
    for number in (-1, 4):
        data = ascii_square(vertex, rows, face, f"3 0 1 2 0\n3 0 2 {number} 5\n", SEVERAL)
        assert_refused(".ply", data, "names a vertex that is not there|out of bounds", {"x.png": PICTURE})


@pytest.mark.parametrize("polygons", [[[0, 1, 2, 3]], [[0, 1, 2], [0, 1, 2, 3]], [[1, 2, 3, 0], [0, 1, 2, 3]]])
def test_texture_coordinates_of_polygons_of_any_lengths(polygons: list[list[int]]) -> None:
    faces = ""
    for polygon in polygons:
        uv = [str(value) for corner in polygon for value in SQUARE[corner, :2]]
        faces += " ".join([str(len(polygon)), *map(str, polygon), str(len(uv)), *uv]) + "\n"
    scene = read(ascii_square(XYZ, PLAIN_ROWS, TEXCOORD, faces, "comment TextureFile x.png\n"))
    (part,) = scene.parts
    assert np.array_equal(part.uv[part.faces], part.vertices[part.faces][:, :, :2])
    assert scene.notes == ()


def test_texture_coordinates_that_are_not_two_for_each_corner_are_noted() -> None:
    scene = read(ascii_square(XYZ, PLAIN_ROWS, TEXCOORD, "4 0 1 2 3 6 0 0 1 0 1 1\n", "comment TextureFile x.png\n"))
    assert scene.parts[0].texture is None
    assert scene.notes[0].startswith("texture coordinates of faces are left out: there must be two for each corner")


def test_a_texture_without_coordinates_and_one_that_is_missing_are_noted() -> None:
    for name, note in (
        ("x.png", "without texture coordinates"),
        ("gone.png", "is left out; put it next to the mesh, or give a zip that holds both"),
    ):
        scene = read(ascii_square(XYZ, PLAIN_ROWS, comment=f"comment TextureFile {name}\n"))
        assert note in scene.notes[0]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"ply\nformat ascii 1.0\n", "header does not end"),
        (header("ascii", XYZ, 1).replace(b"format ascii 1.0\n", b"") + b"0", "names no known format"),
        (header("ascii", XYZ, 1).replace(b"format ascii", b"format morse"), "names no known format"),
        (header("ascii", XYZ, 1) + b"0 0 0\n1 0 0\n", "cut short"),
        (header("ascii", XYZ, 1) + b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1", "cut short"),
        (header("ascii", XYZ, 1) + b"0 0 0\n1 0 0\n1 1 0\n0 1 x\n4 0 1 2 3", "can be read"),
        (header("ascii", XYZ, 1) + b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 9", "names vertex 9"),
        (header("ascii", XYZ, 1) + b"0 0 0\n1 0 0\n1 nan 0\n0 1 0\n3 0 1 2", "NaN or infinite"),
        (header("ascii", XYZ, 1) + b"0 0 0\n1 0 0\n1 1e30 0\n0 1 0\n3 0 1 2", "at most"),
        (header("ascii", XYZ, 0) + b"0 0 0\n1 0 0\n1 1 0\n0 1 0", "no triangles"),
        (header("ascii", XYZ, 10**12), "at most"),
        (header("ascii", XYZ, 9_000_000), "cut short"),
        (header("binary_little_endian", XYZ, 1) + bytes(47), "cut short"),
        (header("binary_little_endian", XYZ, 1) + bytes(48), "can be read"),
        (header("binary_little_endian", XYZ, 9_000_000) + bytes(48) + b"\3" + bytes(12), "can be read"),
        (header("binary_little_endian", XYZ, 2) + bytes(48) + b"\3" + bytes(12) + b"\4" + bytes(12), "cut short"),
        (header("ascii", "", 1).replace(b"element vertex 4\n", b"property float x\n"), "can be read"),
        (header("ascii", XYZ.replace("float", "quad"), 1), "can be read"),
        (header("ascii", XYZ, -5), "its PLY header counts -5 of face; export it again"),
        (header("ascii", XYZ, 4 * 10**9), "4,000,000,000 elements face; at most 12,000,000 are read, and 4,000,000 .*"),
    ],
)
def test_malformed_files(data: bytes, message: str) -> None:
    assert_refused(".ply", data, message)


def test_triangle_strips_are_named() -> None:
    data = (
        header("ascii", XYZ, 1).replace(b"element face 1", b"element tristrips 1")
        + b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3"
    )
    assert_refused(".ply", data, r"a PLY of triangle strips \(tristrips\), which are not read; export it with faces")


def test_one_long_number_does_not_widen_all_the_others() -> None:
    text = ascii_square(XYZ, ["0 0 " + "9" * 50_000, *PLAIN_ROWS[1:]])
    assert_refused_in_little_memory(".ply", text + b" 0" * 5000)


def test_a_long_face_is_counted_before_its_fan_is_made() -> None:
    data = header("ascii", XYZ, 1) + b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n5 0 1 2 3 0"
    with pytest.raises(TooLarge, match="3 triangles and 4 vertices; at most 2 and 6"):
        read_mesh(".ply", data, triangles=2)


@pytest.mark.parametrize("rows", ["3 0 1\n3 0 2 3", "3 0 1 2\n2 0 2 3", "3 0 1 2\n3 0 2 x", "3 0 1 2"])
def test_ascii_rows_of_the_wrong_length(rows: str) -> None:
    data = header("ascii", XYZ, 2) + ("\n".join([*PLAIN_ROWS, rows]) + "\n").encode()
    assert_refused(".ply", data, "can be read|cut short")


def test_edges_and_data_after_the_last_face_are_ignored() -> None:
    data = header("binary_little_endian", XYZ, 1).replace(
        b"end_header", b"element edge 1\nproperty int vertex1\nend_header"
    )
    data += SQUARE.astype("<f4").tobytes() + struct.pack("<B4i", 4, 0, 1, 2, 3) + struct.pack("<i", 9)
    assert read(data).triangles == read(data + b"more").triangles == 2
