import numpy as np
import pytest

from ciir.errors import TooLarge
from ciir.renderer.readers.meshes import mtl, obj
from ciir.renderer.scene import Scene
from ciir.renderer.surface import DEFAULT_COLOR, Surface
from ciir.renderer.writers.pictures import encode_png
from tests.support.meshes import FRONT, UP, assert_refused, assert_refused_in_little_memory, find_area, read_mesh

SQUARE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
UV = b"vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
PICTURE = encode_png(np.arange(16, dtype=np.uint8).reshape(2, 2, 4))
TEXTURED = b"mtllib a.mtl\nusemtl a\n" + SQUARE + UV + b"f 1/1 2/2 3/3\n"


def read(text: bytes, beside: dict[str, bytes] | None = None) -> Scene:
    return read_mesh(".obj", text, beside)


@pytest.mark.parametrize(
    "faces",
    [
        b"f 1 2 3 4",
        b"f 1 2 3\nf 1 3 4",
        b"f -4 -3 -2 -1",
        b"f 1/1 2/2 3/3 4/4",
        b"f 1//1 2//1 3//1 4//1",
        b"f 1/1/1 2/2/1 3/3/1 4/4/1",
        b"f 1/1/1 2/2/1 3/3/1\nf 1 3 4",
        b"f\t1  2 3 \\\n 4\r",
        b"f 1 2 3 4 # all four",
        b"f 1 2\nf 1 2 3 4",
    ],
)
def test_faces_in_every_spelling(faces: bytes) -> None:
    (part,) = read(SQUARE + UV + b"vn 0 0 2\n" + faces).parts
    corners = part.vertices[part.faces]
    assert corners.tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    assert part.colors[:, :3] == pytest.approx(DEFAULT_COLOR[0] * FRONT)


def test_a_polygon_that_is_not_convex_is_drawn_within_its_outline() -> None:
    scene = read(b"v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf -1 -2 -3\nf 5 1 2 3 4\nf 1 2 3 4 5\n")
    assert (find_area(scene), scene.notes) == (6 + 2 * 10, ())


def test_negative_indices_count_back_from_where_they_stand() -> None:
    text = SQUARE + b"f -4 -3 -2\n" + b"v 0 0 5\nv 1 0 5\nv 1 1 5\nf -3 -2 -1\n"
    (part,) = read(text).parts
    assert part.vertices[part.faces][:, :, 2].tolist() == [[0, 0, 0], [5, 5, 5]]


def test_a_texture_whose_name_has_spaces() -> None:
    library = b"newmtl  glazed\t\nKd 1 1 1\nmap_Kd -clamp on -s 1 1 1 -o 0 my texture 2.png\n"
    text = b"mtllib my materials.mtl\n" + SQUARE + UV + b"usemtl glazed\nf 1/1 2/2 3/3 4/4\n"
    scene = read(text, {"my materials.mtl": library, "my texture 2.png": PICTURE})
    (part,) = scene.parts
    assert part.texture.wrap_u == part.texture.wrap_v == "clamp"
    assert np.array_equal(part.texture.pixels[:, :, :3], np.arange(16).reshape(2, 2, 4)[:, :, :3])
    assert part.uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert scene.notes == ()


@pytest.mark.parametrize(
    ("options", "scale", "offset"),
    [(b"-s 2 3 2", [2, 3], [0, 0]), (b"-o 0.25 0 0", [1, 1], [0.25, 0]), (b"-s 2 -o 0 -.5", [2, 1], [0, -0.5])],
)
def test_a_texture_that_is_scaled_and_moved(options: bytes, scale: list[float], offset: list[float]) -> None:
    scene = read(TEXTURED, {"a.mtl": b"newmtl a\nKd 1 1 1\nmap_Kd " + options + b" x.png", "x.png": PICTURE})
    (plain,) = read(TEXTURED, {"a.mtl": b"newmtl a\nKd 1 1 1\nmap_Kd x.png", "x.png": PICTURE}).parts
    assert scene.parts[0].uv.tolist() == (plain.uv * np.float32(scale) + np.float32(offset)).tolist()
    assert scene.notes == ()


def test_several_material_files_on_a_line() -> None:
    text = TEXTURED.replace(b"a.mtl", b"b c.MTL  a.mtl")
    scene = read(text, {"a.mtl": b"newmtl a\nKd 1 0 0", "b c.MTL": b"newmtl b"})
    assert (scene.notes, scene.parts[0].colors[0, 1]) == ((), 0)
    scene = read(text, {"b c.MTL  a.mtl": b"newmtl a\nKd 1 0 0", "a.mtl": b"newmtl a"})  # one name
    assert (scene.notes, scene.parts[0].colors[0, 1]) == ((), 0)
    assert read(text).notes == (
        *(
            f"material file {name} is missing and is left out; put it next to the mesh, or give a zip that holds both"
            for name in ("b c.MTL", "a.mtl")
        ),
        "material a is missing: drawn light grey",
    )


@pytest.mark.parametrize("line", [b"", b"mtllib gone.mtl\n", b"mtllib\n"])
def test_the_only_material_file_is_used_where_the_mesh_names_none_that_is_there(line: bytes) -> None:
    text = line + TEXTURED.partition(b"\n")[2]
    scene = read(text, {"b.MTL": b"newmtl a\nKd 1 0 0"})
    assert scene.parts[0].colors[0, 1] == 0
    assert scene.notes == ("the mesh's material files are missing: m/b.MTL, the only one found, is used",)
    for others in ({"b.mtl": b"newmtl c"}, {"b.mtl": b"newmtl a", "c.mtl": b"newmtl a"}):
        assert read(text, others).notes[-1] == "material a is missing: drawn light grey"


def test_keywords_in_capitals() -> None:
    text = TEXTURED.replace(b"mtllib", b"MTLLIB").replace(b"usemtl", b"UseMtl").replace(b"f 1", b"F 1")
    scene = read(text, {"a.mtl": b"newmtl a\nmap_Kd x.png", "x.png": PICTURE})
    assert scene.parts[0].texture is not None
    assert scene.notes == ()


def test_names_in_quotes() -> None:
    text = TEXTURED.replace(b"a.mtl", b'"a b.mtl"')
    scene = read(text, {"a b.mtl": b'newmtl a\nmap_Kd "x y.png"', "x y.png": PICTURE})
    assert scene.parts[0].texture is not None
    assert scene.notes == ()


def test_a_material_that_only_emits_light_is_drawn_in_its_colour() -> None:
    library = b"newmtl a\nKd 0 0 0\nKe 1 0.5 0"
    (part,) = read(TEXTURED, {"a.mtl": library}).parts
    assert part.colors == pytest.approx(np.tile([1, 0.5, 0, 1], (3, 1)))
    (part,) = read(TEXTURED, {"a.mtl": library + b"\nmap_Ke x.png", "x.png": PICTURE}).parts
    assert part.texture is not None
    scene = read(TEXTURED, {"a.mtl": b"newmtl a\nKd 1 0 0\nKe 1 0.5 0"})
    assert scene.parts[0].colors[:, 2].tolist() == [0] * 3
    assert scene.notes == ("light that a material emits is left out: its diffuse colour is drawn",)


@pytest.mark.parametrize("light", [b"", b"0 0", b"spectral light.rfl", b"xyz 0.3 0.3 0.3"])
def test_emitted_light_that_is_no_colour_is_left_out(light: bytes) -> None:
    scene = read(TEXTURED, {"a.mtl": b"newmtl a\nKd 1 0 0\nKe " + light})
    assert scene.parts[0].colors[:, 0].min() > 0
    assert scene.parts[0].colors[:, 1:3].tolist() == [[0, 0]] * 3
    assert scene.notes == ()


def test_the_folders_of_another_machine_are_looked_through_by_name() -> None:
    library = rb"newmtl a" + b"\n" + rb"map_Kd .\textures\x.png"
    text = b"mtllib a.mtl\n" + SQUARE + UV + b"usemtl a\nf 1/1 2/2 3/3 4/4\n"
    for place in ("textures/x.png", "x.png"):
        (part,) = read(text, {"a.mtl": library, place: PICTURE}).parts
        assert part.texture is not None


def test_a_library_that_is_named_often_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    entries = mtl.parse_entries
    monkeypatch.setattr(mtl, "parse_entries", lambda data: made.append(data) or entries(data))
    names = b"".join(b"mtllib folder%d/a.mtl\n" % i for i in range(98)) + b"mtllib b.mtl\n"
    files = {"a.mtl": b"newmtl m\nKd 1 0 0", "b.mtl": b"newmtl m\nKd 0 0 1"}
    (part,) = read(names + SQUARE + b"usemtl m\nf 1 2 3\n", files).parts
    assert made == list(files.values())
    assert part.colors[0, :3] == pytest.approx([0, 0, FRONT])  # the last of one name counts
    (part,) = read(names + b"mtllib a.mtl\n" + SQUARE + b"usemtl m\nf 1 2 3\n", files).parts
    assert part.colors[0, :3] == pytest.approx([FRONT, 0, 0])


def test_vertex_colours_in_levels_are_noted() -> None:
    text = b"v 0 0 0 255 51 0\nv 1 0 0 255 51 0\nv 0 1 0 255 51 0\nf 1 2 3\n"
    scene = read(text)
    assert scene.parts[0].colors[0] == pytest.approx([FRONT, 0.2 * FRONT, 0, 1])
    assert scene.notes == ("vertex colours above 1 are taken as levels from 0 to 255",)
    assert read(text.replace(b"255 51", b"1.1 0.2")).notes == ()


def test_vertex_colours_beside_positions() -> None:
    text = b"v 0 0 0 1 0 0.5\nv 1 0 0 1 0 0.5\nv 1 1 0 1 0 0.5\nf 1 2 3\n"
    (part,) = read(text).parts
    assert part.colors[:, :3] == pytest.approx(np.tile([FRONT, 0, 0.5 * FRONT], (3, 1)))


def test_normals_of_the_file_are_used() -> None:
    (part,) = read(SQUARE + b"vn 0 1 0\nf 1//1 2//1 3//1\n").parts
    assert part.colors[:, 0] == pytest.approx(DEFAULT_COLOR[0] * UP)


def test_vertices_are_split_where_texture_coordinates_differ() -> None:
    text = b"mtllib a.mtl\nusemtl a\n" + SQUARE + UV + b"f 1/1 2/2 3/3\nf 1/4 3/3 4/4\n"
    (part,) = read(text, {"a.mtl": b"newmtl a\nmap_Kd x.png", "x.png": PICTURE}).parts
    assert len(part.vertices) == 5
    assert part.uv[part.faces].tolist() == [[[0, 0], [1, 0], [1, 1]], [[0, 1], [1, 1], [0, 1]]]


def test_map_d_of_the_same_picture_cuts_out() -> None:
    (part,) = read(TEXTURED, {"a.mtl": b"newmtl a\nmap_Kd x.png\nmap_d x.png", "x.png": PICTURE}).parts
    assert part.alpha_cutoff == 0.5
    assert part.texture.pixels[0, 0, 3] == 3


@pytest.mark.parametrize("is_coloured", [False, True])
@pytest.mark.parametrize("has_alpha", [False, True])
def test_map_d_of_another_picture_cuts_out(is_coloured: bool, has_alpha: bool) -> None:
    mask = np.zeros((4, 4, 4 if has_alpha else 1), np.uint8)
    mask[:2, :2] = 255
    library = b"newmtl a\nKd 1 1 1\nmap_d mask.png" + (b"\nmap_Kd x.png" if is_coloured else b"")
    scene = read(TEXTURED, {"a.mtl": library, "mask.png": encode_png(mask), "x.png": PICTURE})
    (part,) = scene.parts
    assert (part.alpha_cutoff, scene.notes) == (0.5, ())
    assert (part.texture.pixels[..., 3] > 127).tolist() == (
        [[True, False], [False, False]] if is_coloured else (mask[..., -1] > 0).tolist()
    )
    assert part.texture.pixels[0, 1, 0] == (4 if is_coloured else 255)


def test_without_the_picture_of_map_d_it_is_drawn_solid() -> None:
    scene = read(TEXTURED, {"a.mtl": b"newmtl a\nmap_Kd x.png\nmap_d gone.png", "x.png": PICTURE})
    assert scene.parts[0].texture is not None
    assert scene.parts[0].alpha_cutoff is None
    assert scene.notes == (
        "texture gone.png is missing and is left out; put it next to the mesh, or give a zip that holds both",
    )


@pytest.mark.parametrize(
    ("lines", "alpha"),
    [(b"d 0.25", 0.25), (b"d -halo 0.25", 0.25), (b"Tr 0.75", 0.25), (b"d 1\nTr 0", 1), (b"d 0", 1), (b"Tr 1", 1)],
)
def test_dissolve_is_see_through(lines: bytes, alpha: float) -> None:
    two = b"newmtl b\nKd 1 1 1\nnewmtl a\nKd 1 1 1\n" + lines
    text = b"mtllib a.mtl\n" + SQUARE + b"usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n"
    scene = read(text, {"a.mtl": two})
    assert sorted(part.colors[0, 3] for part in scene.parts) == pytest.approx([alpha, 1][: len(scene.parts)])
    assert [part.is_see_through for part in scene.parts] == ([True, False] if alpha < 1 else [False])


def test_a_black_textured_material_is_taken_as_white_with_a_note() -> None:
    scene = read(TEXTURED, {"a.mtl": b"newmtl a\nKd 0 0 0\nmap_Kd x.png", "x.png": PICTURE})
    assert scene.parts[0].colors[0, 0] == pytest.approx(FRONT)
    assert "black Kd" in scene.notes[0]


def test_missing_files_are_named_and_the_mesh_is_read() -> None:
    text = b"mtllib gone.mtl\nusemtl a\n" + SQUARE + b"f 1 2 3\n"
    scene = read(text)
    assert scene.triangles == 1
    assert "gone.mtl" in scene.notes[0]
    assert "material a" in scene.notes[1]
    for name, note in (("../../up.png", "up.png is outside"), ("cut.png", "texture cut.png is left out")):
        scene = read(TEXTURED, {"a.mtl": f"newmtl a\nmap_Kd {name}".encode(), "cut.png": PICTURE[:-20]})
        assert scene.parts[0].texture is None
        assert note in scene.notes[0]


def test_a_texture_without_coordinates_is_left_out_with_a_note() -> None:
    scene = read(TEXTURED + b"f 1 3 4\n", {"a.mtl": b"newmtl a\nmap_Kd x.png", "x.png": PICTURE})
    assert scene.parts[0].texture is None
    assert "without texture coordinates" in scene.notes[0]


def test_lines_and_points_are_left_out_with_a_note() -> None:
    scene = read(SQUARE + b"l 1 2\np 3\nf 1 2 3\n")
    assert len(scene.notes) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SQUARE + b"f 1 2 9\n", "line 5: a face names v 9 but there are 4"),
        (SQUARE + b"f 0 1 2\n", "line 5: a face names v 0 but there are 4"),
        (SQUARE + b"f -9 1 2\n", "line 5: a face names v -9 but there are 4"),
        (SQUARE + b"f 1/9 2/9 3/9\n", "line 5: a face names vt 9 but there are 0"),
        (SQUARE + b"f 1/1/1 2 3\n", "line 5: a face whose corners are written in different ways"),
        (SQUARE + b"vn 0 0 1\nf 1//1 2/1/1 3//1\n", "line 6: a face whose corners are written in different ways"),
        (SQUARE + b"v 1 x 3\nf 1 2 3\n", "can be read"),
        (SQUARE + b"v 1 2\nf 1 2 3\n", "line 5: v needs 3 numbers and has 2"),
        (SQUARE + b"f 1 2 3.5\n", "can be read"),
        (SQUARE + b"v nan 0 0\nf 1 2 5\n", "NaN or infinite"),
        (SQUARE + b"v 1e30 0 0\nf 1 2 5\n", r"1e\+30; at most"),
        (SQUARE + b"f 1 99999999999999999999999 2\n", "can be read"),
        (SQUARE + b"v 5 5 1e\nf 1 2 3", "can be read"),  # cut inside a number
        (SQUARE, r"a\.obj: no triangles"),
    ],
)
def test_malformed_text(text: bytes, message: str) -> None:
    assert_refused(".obj", text, message)


def test_one_long_number_does_not_widen_all_the_others() -> None:
    assert_refused_in_little_memory(".obj", SQUARE * 250 + b"v 0 0 " + b"9" * 50_000 + b"\nf 1 2 1001\n")


def test_lines_are_counted_before_they_are_parsed() -> None:
    for text in (SQUARE + b"f x\n" * 2, b"v x\n" * 4, b"vn x\n" * 4, b"usemtl x\n" * 4):
        with pytest.raises(TooLarge, match=r"over \d lines of .* the 1 triangles"):
            read_mesh(".obj", text, triangles=1)


def test_a_long_face_is_counted_before_its_fan_is_made() -> None:
    data = SQUARE + b"f" + b" 1 2 3 4" * 2 + b"\n"
    with pytest.raises(TooLarge, match="6 triangles and 4 vertices; at most 5 and 15"):
        read_mesh(".obj", data, triangles=5)


def test_many_materials_make_one_surface_and_one_note(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(obj, "Surface", lambda **fields: made.append(1) or Surface(**fields))
    uses = b"".join(b"usemtl m%d\nf 1 2 3\n" % i for i in range(500))
    scene = read(SQUARE + uses)
    assert scene.triangles == 500
    assert scene.notes == ("500 materials (m0, m1, m2, ...) are missing: drawn light grey",)
    library = b"".join(b"newmtl m%d\nKd 0 0 0.%03d\n" % (i, i) for i in range(500))
    scene = read(b"mtllib a.mtl\n" + SQUARE + uses, {"a.mtl": library})
    (part,) = scene.parts
    assert np.unique(np.rint(part.colors[part.faces][:, 0, 2] / FRONT * 1000)).tolist() == list(range(500))
    assert len(made) == 2


def test_materials_have_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(obj, "MAX_MATERIALS", 50)
    uses = [b"usemtl m%d\nf 1 2 3\n" % number for number in range(50)]
    assert read(SQUARE + b"".join(uses[:49] * 2)).triangles == 98  # and none, which is a material too
    with pytest.raises(TooLarge, match="51 materials; at most 50 are read; join them"):
        read(SQUARE + b"".join(uses))


def test_material_files_have_a_limit() -> None:
    libraries = b"".join(b"mtllib %d.mtl\n" % i for i in range(obj.MAX_LIBRARIES + 1))
    with pytest.raises(TooLarge, match="101 material files; at most 100 are read; join them"):
        read(libraries + SQUARE + b"f 1 2 3\n")
    with pytest.raises(TooLarge, match="101 material files; at most 100 are read; join them"):
        read(libraries.replace(b"\nmtllib", b"") + SQUARE + b"f 1 2 3\n")
