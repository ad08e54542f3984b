import io

import numpy as np
import pytest
import trimesh

from ciir.errors import TooLarge
from ciir.renderer.readers.meshes.geometry import MAX_NODES
from ciir.renderer.readers.registry import SUFFIXES, identify
from ciir.renderer.scene import Scene
from ciir.renderer.writers.pictures import encode_png
from tests.support.meshes import FRONT, UP, assert_refused, find_area, read_mesh

CORNERS = "0 0 0 1 0 0 1 1 0 0 1 0"
POLYGON = """<polylist count="1" material="m"><input semantic="VERTEX" source="#v" offset="0"/>{inputs}
<vcount>4</vcount><p>0 1 2 3</p></polylist>"""
EFFECT = "<diffuse><color>1 0 0.5 1</color></diffuse>"
TEXTURE = """<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>"""
NODE = """<node id="{id}"><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="m" target="#mat"/></technique_common></bind_material></instance_geometry></node>"""


def source(name: str, values: str, params: str) -> str:
    count, width = len(values.split()), len(params)
    listed = "".join(f'<param name="{param}" type="float"/>' for param in params)
    return f"""<source id="{name}"><float_array id="{name}a" count="{count}">{values}</float_array><technique_common>
<accessor source="#{name}a" count="{count // width}" stride="{width}">{listed}</accessor></technique_common></source>"""


def document(
    *,
    polygons: str = POLYGON.format(inputs=""),
    sources: str = "",
    scene: str = NODE.format(id="n"),
    effect: str = EFFECT,
    params: str = "",
    up: str = "Y_UP",
    head: str = '<?xml version="1.0" encoding="utf-8"?>',
    library: str = "",
) -> bytes:
    return f"""{head}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified><up_axis>{up}</up_axis></asset>
<library_images><image id="i"><init_from>file:///C:/pictures/a%20b.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>{params}<technique sid="c"><lambert>{effect}</lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="mat"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>{source("p", CORNERS, "XYZ")}{sources}
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{polygons}</mesh></geometry></library_geometries>
{library}<library_visual_scenes><visual_scene id="vs">{scene}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#vs"/></scene></COLLADA>""".encode()


def read(data: bytes, **more: object) -> Scene:
    return read_mesh(".dae", data, **more)


def test_it_is_recognised() -> None:
    for data in (document(), document(head=""), document(head="\ufeff<?xml version='1.0'?>\n<!-- by hand -->\n")):
        assert identify("a.dae", data) is identify("a", data) is SUFFIXES[".dae"]
        assert read(data).triangles == 2


def test_the_colour_of_a_material() -> None:
    (part,) = read(document()).parts
    assert part.colors == pytest.approx(np.tile([FRONT, 0, 0.5 * FRONT, 1], (6, 1)))
    assert part.vertices[part.faces][:, :, :2].tolist() == [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]


def test_a_polygon_that_is_not_convex_is_drawn_within_its_outline() -> None:
    arrow = "0 0 0 4 0 0 1 1 0 0 4 0"
    polygon = POLYGON.format(inputs="").replace("0 1 2 3", "1 2 3 0")
    scene = read(document(polygons=polygon).replace(CORNERS.encode(), arrow.encode()))
    assert (find_area(scene), scene.notes) == (4, ())


@pytest.mark.parametrize(
    ("transparent", "transparency", "alpha"),
    [
        ("<transparent><color>1 1 1 0.5</color></transparent>", 0.5, 0.25),
        ("", 0.5, 0.5),
        ('<transparent opaque="RGB_ZERO"><color>1 1 1 1</color></transparent>', 0.75, 0.25),
        ("<transparent><color>1 1 1 1</color></transparent>", 0, 1.0),
        ("", 1, 1.0),
    ],
)
def test_transparency_is_see_through(transparent: str, transparency: float, alpha: float) -> None:
    effect = f"{EFFECT}{transparent}<transparency><float>{transparency}</float></transparency>"
    (part,) = read(document(effect=effect)).parts
    assert part.is_see_through == (alpha < 1)
    assert part.colors[:, 3] == pytest.approx(np.full(6, alpha))


def test_a_map_of_opacity_is_noted() -> None:
    text = '<transparent><texture texture="t" texcoord="UV"/></transparent>'
    scene = read(document(effect=EFFECT + text, params=TEXTURE))
    assert not scene.is_see_through
    assert "opacity map" in scene.notes[0]


def test_colours_and_normals_of_corners() -> None:
    inputs = '<input semantic="COLOR" source="#c" offset="0"/><input semantic="NORMAL" source="#n" offset="0"/>'
    more = source("c", "0 1 0 " * 4, "RGB") + source("n", "0 1 0 " * 4, "XYZ")
    (part,) = read(document(polygons=POLYGON.format(inputs=inputs), sources=more)).parts
    assert part.colors == pytest.approx(np.tile([0, UP, 0, 1], (6, 1)))


def test_a_texture_is_looked_up_in_the_bundle() -> None:
    inputs = '<input semantic="TEXCOORD" source="#t" offset="0" set="0"/>'
    data = document(
        polygons=POLYGON.format(inputs=inputs),
        sources=source("t", "0 0 1 0 1 1 0 1", "ST"),
        effect='<diffuse><texture texture="t" texcoord="UV"/></diffuse>',
        params=TEXTURE,
    )
    (part,) = read(data, beside={"a b.png": encode_png(np.zeros((2, 2, 3), np.uint8))}).parts
    assert part.texture is not None
    assert np.array_equal(part.uv, part.vertices[:, :2])
    assert "is outside what was given and is left out" in read(data).notes[0]


@pytest.mark.parametrize(("up", "top"), [("Y_UP", [0, 1, 0]), ("Z_UP", [0, 0, -1]), ("X_UP", [-1, 0, 0])])
def test_the_axis_that_points_up(up: str, top: list[float]) -> None:
    scene = read(document(up=up))
    corner = scene.parts[0].vertices[scene.parts[0].faces][1, 2]  # (0, 1, 0) in the file
    assert corner.tolist() == top


def test_transforms_are_where_trimesh_puts_them() -> None:
    inner = NODE.format(id="b").replace("<instance", "<rotate>0 0 1 30</rotate><scale>1 2 3</scale><instance", 1)
    scene = f'<node id="a"><translate>5 6 7</translate>{inner}</node>'
    ours = read(document(scene=scene))
    theirs = trimesh.load_scene(io.BytesIO(document(scene=scene)), file_type="dae")
    assert ours.bounds() == pytest.approx(theirs.bounds, abs=1e-5)


def test_lines_are_left_out() -> None:
    lines = '<lines count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1</p></lines>'
    scene = read(document(polygons=POLYGON.format(inputs="") + lines))
    assert scene.triangles == 2
    assert scene.notes == ("lines are left out: only polygons are drawn",)


def test_instances_without_end() -> None:
    doubled = [f'<node id="n{n}">' + f'<instance_node url="#n{n + 1}"/>' * 2 + "</node>" for n in range(60)]
    library = f"<library_nodes>{NODE.format(id='n60')}{''.join(reversed(doubled))}</library_nodes>"
    with pytest.raises(TooLarge, match="nodes, which is the limit"):
        read(document(library=library, scene='<node id="r"><instance_node url="#n0"/></node>'))
    many = "".join(NODE.format(id=f"i{n}") for n in range(100))
    with pytest.raises(TooLarge, match="22 triangles"):
        read(document(scene=many), triangles=20)
    with pytest.raises(TooLarge, match=f"over {MAX_NODES:,} nodes"):
        read(document(scene='<node id="a"/>' * (MAX_NODES + 1)))
    lines = '<lines count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1</p></lines>' * 200
    with pytest.raises(TooLarge, match="parts in all instances"):
        read(document(polygons=lines, scene=many + many.replace('id="i', 'id="j')))


ENTITIES = "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 10))


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (f'<!DOCTYPE COLLADA [<!ENTITY a0 "x">{ENTITIES}]>', "document type"),
        ('<!DOCTYPE COLLADA [<!ENTITY a SYSTEM "file:///etc/passwd">]>', "document type"),
        ('<!DOCTYPE COLLADA SYSTEM "http://127.0.0.1:9/a.dtd">', "document type"),
        ('<?xml version="1.0" encoding="UTF-7"?>', "UTF-8"),
        ("<?xml version='1.0'  encoding = 'utf-16'?>", "UTF-8"),
    ],
)
def test_entities_are_refused(head: str, message: str) -> None:
    assert_refused(".dae", document(head=head), message)
    assert_refused(".dae", document(head=head).decode().encode("utf-16"), "not in UTF-8")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (document()[:-40], "can be read"),
        (document().replace(b"0 1 2 3", b"0 1 2 9"), "no triangles"),
        (document().replace(b"0 1 2 3", b"0 1 2 -3"), "index is negative"),
        (document().replace(b"<vcount>4<", b"<vcount>2000000000<"), "more corners than it lists"),
        (document().replace(b"#vs", b"#gone"), "without a scene|can be read"),
        (document(polygons=""), "no triangles"),
        (document(effect="<diffuse><color>x</color></diffuse>"), "can be read|no triangles"),
        (b"<COLLADA>", "can be read"),
    ],
)
def test_malformed_files(data: bytes, message: str) -> None:
    assert_refused(".dae", data, message)


def test_parts_that_can_not_be_read_are_noted() -> None:
    broken = POLYGON.format(inputs='<input semantic="NORMAL" source="#gone" offset="0"/>')
    other = f'<geometry id="h"><mesh>{source("q", CORNERS, "XYZ")}{broken}</mesh></geometry></library_geometries>'
    scene = read(document().replace(b"</library_geometries>", other.encode()))
    assert scene.notes == ("1 parts of the file are malformed or not supported and are left out",)
