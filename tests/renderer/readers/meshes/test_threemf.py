import io
import random
import zipfile

import numpy as np
import pytest
import trimesh

from ciir.errors import InputError, TooLarge
from ciir.renderer.readers.meshes.geometry import MAX_NODES
from ciir.renderer.scene import Scene
from ciir.renderer.surface import DEFAULT_COLOR
from tests.support.inputs import make_zip
from tests.support.meshes import assert_refused, read_mesh

NAMESPACES = (
    'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
    'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02" '
    'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"'
)
MATERIALS = """<basematerials id="9"><base name="a" displaycolor="#FF0000"/><base name="b" displaycolor="#0000FF80"/>
</basematerials><m:colorgroup id="8"><m:color color="#00FF00"/><m:color color="#FFFFFF"/></m:colorgroup>"""
VERTICES = '<vertices><vertex x="0" y="0" z="0"/><vertex x="2" y="0" z="0"/><vertex x="0" y="0" z="3"/></vertices>'
MESH = f'<mesh>{VERTICES}<triangles><triangle v1="0" v2="1" v3="2"{{}}/></triangles></mesh>'
OBJECT = f'<object id="1"{{}}>{MESH}</object>'
ELSEWHERE = '<object id="2"><components><component objectid="1" p:path="/3D/a.model"/></components></object>'
ITEM = '<item objectid="1"/>'


def model(resources: str = OBJECT.format("", ""), build: str = ITEM, head: str = "") -> bytes:
    text = f"{head}<model unit='inch' {NAMESPACES}><resources>{resources}</resources><build>{build}</build></model>"
    return make_zip({"[Content_Types].xml": "<Types/>", "_rels/.rels": "<Relationships/>", "3D/3dmodel.model": text})


def read(data: bytes, **limits: int) -> Scene:
    return read_mesh(".3mf", data, **limits)


def colors(scene: Scene) -> list[list[float]]:
    """The colours of the corners of the first triangle, without light."""
    part = scene.parts[0]
    rgb = part.colors[part.faces[0], :3]
    return (rgb / rgb.max()).tolist()  # type: ignore[no-any-return]


def bounds_with_y_up(mesh: trimesh.Trimesh) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    x, y, z = mesh.vertices.T
    return np.array([[x.min(), z.min(), -y.max()], [x.max(), z.max(), -y.min()]])


def test_z_is_up_and_coordinates_are_the_files() -> None:
    assert read(model()).bounds().tolist() == [[0, 0, 0], [2, 3, 0]]


@pytest.mark.parametrize(
    ("on_object", "on_triangle", "expected"),
    [
        (' pid="9" pindex="1"', "", [[0, 0, 1]] * 3),
        ("", ' pid="9" p1="0"', [[1, 0, 0]] * 3),
        (' pid="9" pindex="1"', ' pid="8" p1="0" p2="1" p3="0"', [[0, 1, 0], [1, 1, 1], [0, 1, 0]]),
    ],
)
def test_colours(on_object: str, on_triangle: str, expected: list[list[float]]) -> None:
    scene = read(model(MATERIALS + OBJECT.format(on_object, on_triangle)))
    assert colors(scene) == expected
    assert scene.notes == ()


@pytest.mark.parametrize(("index", "alpha"), [(0, 1.0), (1, 128 / 255)])
def test_colours_with_alpha_are_see_through(index: int, alpha: float) -> None:
    (part,) = read(model(MATERIALS + OBJECT.format(f' pid="9" pindex="{index}"', ""))).parts
    assert part.is_see_through == (alpha < 1)
    assert part.colors[:, 3] == pytest.approx(np.full(3, alpha))


def test_other_materials_are_noted() -> None:
    scene = read(model(OBJECT.format(' pid="7"', "")))
    assert colors(scene) == [[1, 1, 1]] * 3
    assert scene.notes == ("3MF textures and mixed materials are left out: light grey is drawn",)
    assert read(model()).parts[0].colors[0, 0] <= DEFAULT_COLOR[0]


def test_components_and_transforms_are_where_trimesh_puts_them() -> None:
    inner = '<component objectid="1" transform="0 1 0 -1 0 0 0 0 2 5 6 7"/><component objectid="1"/>'
    resources = OBJECT.format("", "") + f'<object id="2"><components>{inner}</components></object>'
    data = model(resources, '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 10 0 0"/><item objectid="1"/>')
    scene, theirs = read(data), trimesh.load_scene(io.BytesIO(data), file_type="3mf").to_mesh()
    assert scene.triangles == len(theirs.faces) == 3
    assert scene.bounds() == pytest.approx(bounds_with_y_up(theirs))


def test_many_instances_are_all_there() -> None:
    inner = '<component objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 5"/>' * 120
    resources = OBJECT.format("", "") + f'<object id="2"><components>{inner}</components></object>'
    assert read(model(resources, '<item objectid="2"/>' * 120)).triangles == 120 * 120


def test_empty_meshes_count_too() -> None:
    empty = "<mesh><vertices/><triangles/></mesh>"
    resources = f'<object id="1">{empty * 200}</object>'
    assert_refused(".3mf", model(resources, ITEM * 200), "parts in all instances")


def test_components_without_end() -> None:
    nested = "".join(
        f'<object id="{n}"><components>{f"<component objectid={chr(34)}{n - 1}{chr(34)}/>" * 2}</components></object>'
        for n in range(2, 70)
    )
    with pytest.raises(TooLarge, match=f"over {MAX_NODES:,} components"):
        read(model(OBJECT.format("", "") + nested, '<item objectid="69"/>'))
    with pytest.raises(TooLarge, match="triangles and"):
        read(model(build=ITEM * 30), triangles=20)


@pytest.mark.parametrize("limits", [{"bytes": 400}, {"files": 2}, {"triangles": 0}])
def test_limits(limits: dict[str, int]) -> None:
    with pytest.raises(TooLarge):
        read(model(), **limits)


def test_a_zip_or_xml_that_swells() -> None:
    with pytest.raises(TooLarge, match="over 250 times its size"):
        read(model(" " * 10_000_000))
    with pytest.raises(TooLarge, match="more XML than 1 triangles need"):
        read(model("<a/>" * 2000), triangles=1)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (make_zip({"a.txt": ""}), "without 3d/3dmodel.model"),
        (make_zip({"../3D/3dmodel.model": ""}), "leads out of the zip"),
        (b"PK\3\4 cut", "truncated zip"),
        (model(head='<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>'), "document type"),
        (model("<open>"), "can be read"),
        (model(build='<item objectid="5"/>'), "object 5 is used before it is defined"),
        (model(build=""), "no triangles"),
        (model(OBJECT.format("", "").replace('v3="2"', 'v3="-1"')), "names vertex -1"),
        (model(OBJECT.format("", "").replace('v3="2"', 'v3="x"')), r"can be read|can't be read"),
        (model(OBJECT.format("", "").replace('x="2"', 'x="2 2 2 2"')), "number in its mesh can't be read"),
        (model(MATERIALS + OBJECT.format(' pid="9"', ' p1="4"')), "can be read"),
        (model(OBJECT.format("", "") + ELSEWHERE), "parts in other model files"),
    ],
)
def test_malformed_files(data: bytes, message: str) -> None:
    assert_refused(".3mf", data, message)


def test_hostile_bytes_end_in_a_scene_or_in_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    rng = random.Random(1)  # noqa: S311
    text = zipfile.ZipFile(io.BytesIO(model(MATERIALS + OBJECT.format(' pid="9"', "")))).read("3D/3dmodel.model")
    messages = []
    for number in range(400):
        broken = bytearray(text if number % 2 else model())
        at = rng.randrange(len(broken))
        broken[at : at + rng.randrange(8)] = rng.choice((b"-1", b"nan", b'"', b"<", b"\0", b"99999999999", b""))
        try:
            read(make_zip({"3D/3dmodel.model": bytes(broken)}) if number % 2 else bytes(broken))
        except InputError as error:
            messages.append(str(error))
    assert len(messages) > 100
    assert not [message for message in messages if "\n" in message or len(message) > 400]
    assert capfd.readouterr() == ("", "")
