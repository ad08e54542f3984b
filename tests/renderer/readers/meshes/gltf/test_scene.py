import base64
import io
import struct
import sys
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from PIL import Image

from ciir.errors import InvalidGeometry, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers import pictures
from ciir.renderer.readers.meshes.gltf import document as gltf
from ciir.renderer.readers.meshes.gltf import scene as gltf_scene
from ciir.renderer.readers.meshes.gltf.accessors import read_accessor
from ciir.renderer.readers.meshes.gltf.nodes import local_matrix
from ciir.renderer.readers.meshes.texture_files import Resolver
from ciir.renderer.shading import encode_srgb, shade
from tests.support.meshes import FRONT, assert_refused, read_mesh
from tests.support.meshes.gltf import INDICES, PIXELS, SQUARE, UV, Model
from tests.support.meshes.ktx2 import UASTC
from tests.support.paths import SHARED


def test_a_square() -> None:
    (part,) = Model().read().parts
    assert np.array_equal(part.vertices, SQUARE)
    assert part.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert part.colors == pytest.approx(np.tile([FRONT, FRONT, FRONT, 1], (4, 1)))
    assert part.texture is None
    assert part.uv is None


def test_buffers_embedded_and_beside() -> None:
    model = Model()
    embedded = "data:application/octet-stream;base64," + base64.b64encode(model.binary).decode()
    assert read_mesh(".gltf", model.gltf(embedded)).triangles == 2
    assert read_mesh(".gltf", model.gltf("a%20b.bin"), {"a b.bin": model.binary}).triangles == 2


@pytest.mark.parametrize(
    "uri",
    ["http://example.org/a.bin", "file:///etc/passwd", "../../a.bin", "/etc/passwd", "..%2F..%2Fa.bin", "C:/a.bin"],
)
def test_uris_that_lead_out_are_refused(uri: str) -> None:
    assert_refused(".gltf", Model().gltf(uri), r"is outside what was given.*\.glb")


def test_a_buffer_that_is_not_there_is_named() -> None:
    assert_refused(
        ".gltf", Model().gltf("mesh.bin"), r"^(?!.*left out).*buffer mesh\.bin is missing; give a zip .* one \.glb file"
    )


@pytest.mark.parametrize("name", ["a.png", "../secret.png", "https://example.org/a.png", ""])
def test_a_texture_that_is_not_there_or_no_picture_is_left_out_with_a_note(name: str) -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.json["images"] = [{"uri": name} if name else {"bufferView": model.view(b"BM as bitmaps start")}]
    scene = model.read()
    assert scene.parts[0].texture is None
    assert len(scene.notes) == 1
    assert (name.rpartition("/")[2] or "texture image 0 is left out") in scene.notes[0]


def test_a_texture_keeps_its_pixels_its_wrap_and_its_place() -> None:
    (part,) = Model(TEXCOORD_0=UV).texture(wrapS=33071, wrapT=33648).read().parts
    assert (part.texture.wrap_u, part.texture.wrap_v) == ("clamp", "mirror")
    assert np.array_equal(part.texture.pixels[:, :, :3], PIXELS[:, :, :3])
    assert (part.texture.pixels[:, :, 3] == 255).all()  # alphaMode OPAQUE: its alpha plays no part
    assert part.uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]  # from the lower left


def test_texture_coordinates_as_normalised_integers_and_of_another_set() -> None:
    model = Model(TEXCOORD_0=np.zeros_like(UV)).texture()
    model.primitive["attributes"]["TEXCOORD_1"] = model.add((UV * 255).astype(np.uint8), normalized=True)
    model.material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 1
    (part,) = model.read().parts
    assert part.uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_texture_transform_scales_then_turns_then_shifts() -> None:
    model = Model(TEXCOORD_0=np.array([[1, 0], [0, 1], [0, 0], [1, 1]], np.float32)).texture()
    transform = {"offset": [0.25, 0.5], "rotation": np.pi / 2, "scale": [2, 3]}
    model.material["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = {"KHR_texture_transform": transform}
    model.json["extensionsRequired"] = ["KHR_texture_transform"]
    (part,) = model.read().parts
    # Counter-clockwise with v going down takes (1, 0), right, to (0, -1), up.
    expected = np.array([[0.25, 0.5 - 2], [0.25 + 3, 0.5], [0.25, 0.5], [0.25 + 3, 0.5 - 2]])
    assert part.uv == pytest.approx(np.stack([expected[:, 0], 1 - expected[:, 1]], 1), abs=1e-6)


@pytest.mark.parametrize("color", [np.array([0.5, 1, 0, 1], np.float32), np.array([128, 255, 0], np.uint8)])
def test_factors_and_vertex_colours_are_linear_and_go_through_the_curve(color: np.ndarray) -> None:
    model = Model()
    model.primitive["attributes"]["COLOR_0"] = model.add(np.tile(color, (4, 1)), normalized=True)
    model.material["pbrMetallicRoughness"] = {"baseColorFactor": [0.2, 0.2, 1, 1]}
    (part,) = model.read().parts
    curve = encode_srgb(np.array([0.2, 128 / 255 if color.dtype == np.uint8 else 0.5]))
    assert part.colors[0] == pytest.approx([curve[0] * curve[1] * FRONT, curve[0] * FRONT, 0, 1])


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("KHR_materials_pbrSpecularGlossiness", {"diffuseFactor": [1, 0, 0, 1]}, [FRONT, 0, 0, 1]),
        ("KHR_materials_unlit", {}, [1, 1, 1, 1]),
    ],
)
def test_materials_of_extensions(name: str, values: dict[str, object], expected: list[float]) -> None:
    model = Model()
    model.material["extensions"] = {name: values}
    assert model.read().parts[0].colors[0] == pytest.approx(expected)


def test_mask_keeps_alpha_and_its_cutoff() -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.material |= {"alphaMode": "MASK", "alphaCutoff": 0.25}
    (part,) = model.read().parts
    assert part.alpha_cutoff == 0.25
    assert np.array_equal(part.texture.pixels, PIXELS)


@pytest.mark.parametrize("mode", ["BLEND", "OPAQUE"])
def test_blend_is_see_through(mode: str) -> None:
    model = Model()
    model.material |= {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.75]}}
    scene = model.read()
    assert scene.is_see_through == (mode == "BLEND")
    assert scene.parts[0].colors[:, 3] == pytest.approx(0.75 if mode == "BLEND" else 1.0)


def test_blend_keeps_the_alpha_of_a_texture() -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.material |= {"alphaMode": "BLEND"}
    (part,) = model.read().parts
    assert part.is_see_through
    assert np.array_equal(part.texture.pixels, PIXELS)


def test_nodes_place_vertices_and_normals() -> None:
    normals = np.tile(np.array([0, 0.6, 0.8], np.float32), (4, 1))
    model = Model(NORMAL=normals)
    half = np.sqrt(0.5)
    model.json["nodes"] = [
        {"children": [1], "translation": [10, 0, 0]},
        {"mesh": 0, "rotation": [0, half, 0, half], "scale": [1, 2, 1]},  # a quarter turn: z goes to x
    ]
    (part,) = model.read().parts
    expected = np.stack([10 + SQUARE[:, 2], 2 * SQUARE[:, 1], -SQUARE[:, 0]], 1)
    assert part.vertices == pytest.approx(expected, abs=1e-6)
    normal = np.array([[0.8, 0.3, 0.0]]) / np.hypot(0.8, 0.3)  # inverse transpose: stretched in y, flatter in y
    assert part.colors[:, 0] == pytest.approx(np.full(4, shade(normal)[0]), abs=1e-6)


def test_a_mirror_keeps_outside_outside() -> None:
    for attributes in ({}, {"NORMAL": np.tile(np.array([0, 0, 1], np.float32), (4, 1))}):
        model = Model(**attributes)
        model.json["nodes"] = [{"mesh": 0, "scale": [-1, 1, 1]}]
        (part,) = model.read().parts
        assert part.colors[:, 0] == pytest.approx(FRONT)
        a, b, c = part.vertices[part.faces[0]]
        assert np.cross(b - a, c - a)[2] > 0


def test_a_node_as_a_matrix_is_column_major() -> None:
    matrix = local_matrix({"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]})
    assert matrix[:3, 3].tolist() == [5, 6, 7]
    assert local_matrix({}).tolist() == np.eye(4).tolist()


def test_a_mesh_may_be_placed_twice() -> None:
    model = Model()
    model.json["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 5]}]
    model.json["scenes"] = [{"nodes": [0, 1]}]
    scene = model.read()
    assert scene.triangles == 4
    assert scene.bounds().tolist() == [[0, 0, 0], [1, 1, 5]]


def test_without_scenes_all_roots_are_drawn() -> None:
    model = Model()
    del model.json["scenes"], model.json["scene"]
    model.json["nodes"] = [{"children": [1]}, {"mesh": 0}]
    assert model.read().triangles == 2


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
    assert model.read().parts[0].vertices[2].tolist() == [3, 4, 5]


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


@pytest.mark.parametrize("extension", ["EXT_texture_webp", "KHR_texture_basisu"])
@pytest.mark.parametrize("is_beside_png", [True, False])
def test_textures_of_extensions(extension: str, is_beside_png: bool) -> None:
    if extension == "KHR_texture_basisu":
        pytest.importorskip("opengl_basisu", reason="needs the extra basisu")
    model = Model(TEXCOORD_0=UV).texture()
    pixels = np.full((4, 4, 3), 90, np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", lossless=True)
    data = file.getvalue() if extension == "EXT_texture_webp" else UASTC
    model.json["images"].append({"bufferView": model.view(data)})
    texture = {"extensions": {extension: {"source": 1}}}
    model.json["textures"] = [texture | ({"source": 0} if is_beside_png else {})]
    model.json["extensionsUsed"] = [extension]
    (part,) = model.read().parts
    # WebP is as good as a PNG; Basis Universal is lossy.
    size = (4, 4) if extension == "EXT_texture_webp" else (2, 2) if is_beside_png else (8, 12)
    assert part.texture.pixels.shape == (*size, 4)


def test_basis_textures_that_are_required_need_a_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf, "find_spec", lambda _: None)
    model = Model(TEXCOORD_0=UV).texture()
    model.json["extensionsUsed"] = ["KHR_texture_basisu"]
    assert model.read().parts[0].texture is not None
    model.json["extensionsRequired"] = ["KHR_texture_basisu"]
    with pytest.raises(UnsupportedType, match=r"opengl-basisu decodes; run pip install 'ciir\[basisu\]', or export"):
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


def test_draco_without_a_decoder_or_corrupt(monkeypatch: pytest.MonkeyPatch) -> None:
    model = draco_model()
    with monkeypatch.context() as absent:
        absent.setitem(sys.modules, "DracoPy", None)
        assert_refused(".glb", model.glb(), "DracoPy is not installed")
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


def test_primitives_without_a_surface_are_counted_too(monkeypatch: pytest.MonkeyPatch) -> None:
    model = Model()
    model.json["meshes"].append({"primitives": [{"mode": 0}] * 30})
    model.json["nodes"] = [{"mesh": 0}] + [{"mesh": 1}] * 10
    model.json["scenes"] = [{"nodes": list(range(11))}]
    assert model.read().notes == ("points and lines are left out: they have no surface",)
    monkeypatch.setattr(gltf_scene, "MAX_PRIMITIVES", 300)
    with pytest.raises(TooLarge, match="over 300 primitives in its nodes"):
        model.read()


def test_a_meshs_weights_are_looked_at_once() -> None:
    class Weights(list[float]):
        looks = 0

        def __iter__(self) -> Iterator[float]:
            Weights.looks += 1
            return super().__iter__()

    mesh = {"weights": Weights([0.0, 0.5]), "primitives": []}
    document = gltf.Document("a", {"meshes": [mesh], "nodes": [{"mesh": 0}] * 20}, None, Resolver({}, "a"), 100)
    assert list(gltf_scene.find_surfaces(document)) == []
    assert Weights.looks == 1
    assert document.resolver.notes == ["morph targets are left at zero"]


def test_a_mesh_that_is_repeated_without_end() -> None:
    model = Model()
    model.json["nodes"] = [{"mesh": 0}] * 50
    model.json["scenes"] = [{"nodes": list(range(50))}]
    with pytest.raises(TooLarge, match="62 triangles and 124 vertices; at most 60 and"):
        model.read(triangles=60)


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


def test_a_picture_is_decoded_once_however_often_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    decode = pictures.decode
    monkeypatch.setattr(pictures, "decode", lambda *args, **more: calls.append(1) or decode(*args, **more))
    model = Model(TEXCOORD_0=UV).texture()
    view = model.view(b"\x89PNG\r\n\x1a\n")
    model.json["images"] = [{"bufferView": view}] * 5
    model.json["textures"] = [{"source": i} for i in range(5)]
    model.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(5)]
    model.json["meshes"][0]["primitives"] = [{**model.primitive, "material": i} for i in range(5)]
    assert len(model.read().notes) == 1
    assert len(calls) == 1
