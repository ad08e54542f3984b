import base64
import struct
from collections.abc import Callable

import numpy as np
import pytest

from ciir.errors import InvalidGeometry, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers.meshes.gltf import document as gltf
from ciir.renderer.readers.meshes.gltf.accessors import read_accessor
from ciir.renderer.readers.meshes.texture_files import Resolver
from tests.support.meshes import FRONT, assert_refused, read_mesh
from tests.support.meshes.gltf import INDICES, SQUARE, UV, Model
from tests.support.paths import SHARED


def test_a_square() -> None:
    (part,) = Model().read().parts
    assert np.array_equal(part.vertices, SQUARE)
    assert part.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert part.colors == pytest.approx(np.tile([FRONT, FRONT, FRONT, 1], (4, 1)))
    assert part.texture is None
    assert part.uv is None


def test_faces_without_normals_are_flat() -> None:  # section 3.7.2.1
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0]], np.float32)  # 11 degrees at the diagonal
    (part,) = Model(POSITION=vertices).read().parts
    assert np.ptp(part.colors[part.faces], axis=1) == pytest.approx(0)
    assert len(np.unique(part.colors[:, 0])) == 2


def test_buffers_embedded_and_beside() -> None:
    model = Model()
    embedded = "data:application/octet-stream;base64," + base64.b64encode(model.binary).decode()
    assert read_mesh(".gltf", model.gltf(embedded)).triangles == 2
    for name in ("a b.bin", "a%20b.bin"):
        assert read_mesh(".gltf", model.gltf("a%20b.bin"), {name: model.binary}).triangles == 2


@pytest.mark.parametrize("more", range(3))
def test_base64_without_padding(more: int) -> None:
    model = Model()
    text = base64.b64encode(model.binary + bytes(more)).decode()
    for given in (text, text.rstrip("=")):
        assert read_mesh(".gltf", model.gltf("data:application/octet-stream;base64," + given)).triangles == 2


@pytest.mark.parametrize(
    "uri",
    ["http://example.org/a.bin", "file:///etc/passwd", "../../a.bin", "/etc/passwd", "..%2F..%2Fa.bin", "C:/a.bin"],
)
def test_uris_that_lead_out_are_refused(uri: str) -> None:
    assert_refused(".gltf", Model().gltf(uri), r"is outside what was given.*\.glb")


def test_a_buffer_that_is_not_there_is_named() -> None:
    assert_refused(
        ".gltf", Model().gltf("mesh.bin"), r"^(?!.*left out).*mesh\.bin is missing; put it .* a zip .* one \.glb file"
    )


@pytest.mark.parametrize(("mode", "indices"), [(5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])])
def test_strips_and_fans(mode: int, indices: list[int]) -> None:
    model = Model()
    model.primitive |= {"mode": mode, "indices": model.add(np.array(indices, np.uint8))}
    (part,) = model.read().parts
    corners = part.vertices[part.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert normals.tolist() == [[0, 0, 1], [0, 0, 1]]


def test_without_indices_vertices_come_in_threes() -> None:
    model = Model()
    del model.primitive["indices"]
    assert model.read().triangles == 1


def test_points_are_left_out_and_points_alone_are_refused() -> None:
    model = Model()
    model.primitive["mode"] = 0
    with pytest.raises(InvalidGeometry, match="no triangles"):
        model.read()
    model.json["meshes"][0]["primitives"].append({**model.primitive, "mode": 4})
    scene = model.read()
    assert scene.triangles == 2
    assert "points" in scene.notes[0]


def test_strided_accessors() -> None:
    model = Model()
    packed = np.concatenate([SQUARE, np.full((4, 2), np.nan, np.float32)], 1)
    index = model.view(packed.tobytes())
    model.json["bufferViews"][index]["byteStride"] = 20
    model.json["accessors"].append({"bufferView": index, "componentType": 5126, "count": 4, "type": "VEC3"})
    model.primitive["attributes"]["POSITION"] = len(model.json["accessors"]) - 1
    assert np.array_equal(model.read().parts[0].vertices, SQUARE)


def test_sparse_accessors() -> None:
    model = Model()
    model.json["accessors"][model.primitive["attributes"]["POSITION"]]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": model.view(np.array([2], np.uint16).tobytes()), "componentType": 5123},
        "values": {"bufferView": model.view(np.array([3, 4, 5], np.float32).tobytes())},
    }
    assert [3, 4, 5] in model.read().parts[0].vertices.tolist()


def test_a_sparse_accessor_without_a_buffer_view_is_of_zeros() -> None:
    model = Model()
    accessor = model.json["accessors"][model.primitive["attributes"]["POSITION"]]
    del accessor["bufferView"]
    accessor["sparse"] = {
        "count": 3,
        "indices": {"bufferView": model.view(np.array([1, 2, 3], np.uint16).tobytes()), "componentType": 5123},
        "values": {"bufferView": model.view(SQUARE[1:].tobytes())},
    }
    assert np.array_equal(model.read().parts[0].vertices, SQUARE)


def test_quantised_positions() -> None:
    model = Model()
    model.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    model.primitive["attributes"]["POSITION"] = model.add((SQUARE * 7).astype(np.int16))
    assert np.array_equal(model.read().parts[0].vertices, SQUARE * 7)


def test_extensions_that_cannot_be_decoded_are_refused_by_name() -> None:
    for extension in ("MPEG_media", "VENDOR_x"):
        model = Model()
        model.json["extensionsRequired"] = [extension]
        with pytest.raises(UnsupportedType, match=f"requires the extension {extension}.*export it again without it"):
            model.read()


def test_extensions_without_effect_or_unknown_are_noted() -> None:
    model = Model()
    model.json["extensionsRequired"] = ["KHR_materials_clearcoat"]
    model.json["extensionsUsed"] = ["KHR_materials_clearcoat", "KHR_mesh_quantization", "VENDOR_x"]
    clearcoat, vendor = model.read().notes
    assert "KHR_materials_clearcoat has no effect" in clearcoat
    assert "VENDOR_x is not decoded here: what it adds is left out" in vendor


def test_basis_textures_that_are_required_need_a_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf, "find_spec", lambda _: None)
    model = Model(TEXCOORD_0=UV).texture()
    model.json["extensionsUsed"] = ["KHR_texture_basisu"]
    assert model.read().parts[0].texture is not None
    model.json["extensionsRequired"] = ["KHR_texture_basisu"]
    with pytest.raises(UnsupportedType, match=r"opengl-basisu decodes; run pip install '\.\[basisu\]' .*, or export"):
        model.read()


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared")
def test_a_real_file_with_webp_textures_under_draco() -> None:
    scene = read_mesh(".glb", (SHARED / "data/meshes/webp-box.glb").read_bytes())
    assert scene.triangles == 10
    assert scene.bounds().tolist() == [[-1, -1, -1], [1, 1, 1]]


def draco_model() -> Model:
    import DracoPy

    data = DracoPy.encode(SQUARE, faces=INDICES.reshape(-1, 3).astype(np.uint32), preserve_order=True)
    model = Model()
    unique = DracoPy.decode(data).attributes[0]["unique_id"]
    model.primitive["extensions"] = {
        "KHR_draco_mesh_compression": {"bufferView": model.view(data), "attributes": {"POSITION": unique}}
    }
    model.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    for accessor in model.json["accessors"]:
        del accessor["bufferView"]
    return model


def test_draco_gives_the_geometry_that_went_in() -> None:
    (part,) = draco_model().read().parts
    assert part.vertices[part.faces].reshape(-1, 3) == pytest.approx(SQUARE[INDICES], abs=1e-3)


def test_corrupt_draco() -> None:
    model = draco_model()
    at = model.binary.index(b"DRACO")
    model.binary = model.binary[: at + 12] + bytes(len(model.binary) - at - 12)
    with pytest.raises(Unreadable, match="Draco"):
        model.read()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.json.update(asset={}), "glTF version None"),
        (lambda m: m.json.update(asset={"version": "1.0"}), r"glTF version 1\.0; version 2\.0 is read"),
        (lambda m: m.json["nodes"][0].update(mesh=7), "names meshes 7"),
        (lambda m: m.json["nodes"][0].update(mesh="x"), "names meshes"),
        (lambda m: m.json["nodes"][0].update(children=[0]), "two parents or is its own"),
        (lambda m: m.json["scenes"][0].update(nodes=[0, 0]), "two parents"),
        (lambda m: m.primitive.update(material=3), "names materials 3"),
        (lambda m: m.primitive.update(indices=99), "names accessors 99"),
        (lambda m: m.json["accessors"][1].update(count=5), "ends beyond its buffer view"),
        (lambda m: m.json["accessors"][1].update(byteOffset=-12), "ends beyond its buffer view"),
        (lambda m: m.json["accessors"][1].update(count=10**15), "elements; at most"),
        (lambda m: m.json["accessors"][1].update(count=10**300), r"^.{1,200}$"),
        (lambda m: m.json["accessors"][1].update(count=-1), "counts -1 elements; export it again"),
        (lambda m: m.json["accessors"][1].update(componentType=1), "no GLB data that can be read"),
        (lambda m: m.json["bufferViews"][1].update(byteLength=10**9), "ends beyond its buffer"),
        (lambda m: m.json["bufferViews"][1].update(byteStride=-4), "ends beyond its buffer view"),
        (lambda m: m.json["bufferViews"][1].update(buffer=1), "names buffers 1"),
        (lambda m: m.primitive["attributes"].update(NORMAL=0), "differ in length"),
        (lambda m: m.primitive["attributes"].pop("POSITION"), "POSITION"),
        (lambda m: m.json.update(meshes=[7]), "not an object"),
        (lambda m: m.json.update(nodes={"a": 1}), "names nodes 0"),
        (lambda m: m.json["nodes"][0].update(matrix=[1, 2]), "no GLB data that can be read"),
        (lambda m: m.json["nodes"][0].update(scale=[float("nan")] * 3), "NaN"),
        (lambda m: m.json["nodes"][0].update(scale=[1e200] * 3), "1e\\+200; at most"),
        (lambda m: m.json["nodes"][0].update(scale=[0, 0, 0]), "zero area"),
        (lambda m: m.primitive.update(indices=m.add(np.array([0, 1, 9], np.uint16))), "names vertex 9"),
    ],
)
def test_malformed_documents(change: Callable[[Model], object], message: str) -> None:
    model = Model()
    change(model)
    assert_refused(".glb", model.glb(), message)


def test_what_sparse_accessors_replace_is_counted() -> None:
    model = Model()
    count = 1000
    indices, values = model.view(bytes(count)), model.view(bytes(12 * count))
    model.json["accessors"][1]["sparse"] = {
        "count": count,
        "indices": {"bufferView": indices, "componentType": 5121},
        "values": {"bufferView": values},
    }
    model.json["meshes"][0]["primitives"] *= 50
    with pytest.raises(TooLarge, match="have 3,024 elements; at most 3,000 are read together"):
        model.read(triangles=200)


def test_vertices_that_are_repeated_without_end() -> None:
    model = Model(POSITION=np.zeros((100, 3), np.float32))
    model.json["meshes"][0]["primitives"] *= 50
    with pytest.raises(TooLarge, match=r"3,100 vertices; at most 1,000 and 3,000"):
        model.read(triangles=1000)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"glTF", "cut short"),
        (Model().glb()[:-8], "cut short"),
        (b"glTF" + struct.pack("<II", 1, 20) + bytes(8), "GLB version 1"),
        (b"glTF" + struct.pack("<II", 2, 20) + struct.pack("<II", 99, 0x4E4F534A), "ends beyond the file"),
        (b"glTF" + struct.pack("<II", 2, 20) + bytes(8), "without a JSON chunk"),
        (b"{", "JSON can't be read"),
        (b'{"asset": 2}', "without an asset"),
        (b"[" * 100_000, "JSON can't be read"),
    ],
)
def test_broken_containers(data: bytes, message: str) -> None:
    assert_refused(".glb" if data.startswith(b"glTF") else ".gltf", data, message)


def empty(count: int) -> dict[str, object]:
    return {"componentType": 5126, "type": "VEC3", "count": count}


def test_positions_and_indices_without_data() -> None:
    for change in ({"indices": 2}, {"attributes": {"POSITION": 2}}):
        model = Model()
        model.json["accessors"].append(empty(3))
        model.primitive.update(change)
        with pytest.raises(Unreadable, match=r"accessor 2, of (positions|indices), has no data; export it again"):
            model.read()


def test_only_the_attributes_that_are_drawn_are_read() -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.json["accessors"].append(empty(10**9))
    model.primitive["attributes"] |= dict.fromkeys(("TEXCOORD_1", "TANGENT", "JOINTS_0"), 3)
    assert model.read().parts[0].texture is not None
    model.primitive["attributes"]["NORMAL"] = 3  # of another length than the positions: not filled with zeros first
    with pytest.raises(Unreadable, match="differ in length"):
        model.read()


def test_all_accessors_together_have_a_limit() -> None:
    data = Model().glb()
    document = gltf.parse(data, name="a", resolver=Resolver({}, "a"), max_triangles=1)
    assert len(read_accessor(document, 0)) == 6
    assert len(read_accessor(document, 0)) == 6
    with pytest.raises(TooLarge, match=r"accessor 0 .* have 18 elements; at most 15 are read together; decimate"):
        read_accessor(document, 0)
