import io

import numpy as np
import pytest
from PIL import Image

from ciir.renderer.placement import Placement
from ciir.renderer.readers import meshes, pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.meshes import UNLIT
from ciir.renderer.readers.registry import SUFFIXES
from ciir.renderer.shading import decode_srgb, encode_srgb
from ciir.renderer.writers.pictures import encode_png
from tests.support.meshes import FRONT, read_mesh
from tests.support.meshes.gltf import PIXELS, UV, Model
from tests.support.meshes.ktx2 import UASTC


@pytest.mark.parametrize("name", ["a.png", "../secret.png", "https://example.org/a.png", ""])
def test_a_texture_that_is_not_there_or_no_picture_is_left_out_with_a_note(name: str) -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.json["images"] = [{"uri": name} if name else {"bufferView": model.view(b"BM as bitmaps start")}]
    scene = model.read()
    assert scene.parts[0].texture is None
    assert len(scene.notes) == 1
    assert (name.rpartition("/")[2] or "texture image 0 is left out") in scene.notes[0]


def test_an_image_without_data_is_left_out_with_a_note() -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.json["images"] = [{"mimeType": "image/png"}]
    scene = model.read()
    assert scene.parts[0].texture is None
    assert scene.notes == ("texture image 0 is left out: it has no data; export it again",)


@pytest.mark.parametrize("name", ["a%20b.png", "a b.png"])
def test_a_texture_whose_uri_is_quoted_or_not(name: str) -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.json["images"] = [{"uri": "a%20b.png"}]
    scene = read_mesh(".glb", model.glb(), {name: encode_png(PIXELS)})
    assert (scene.parts[0].texture is None, scene.notes) == (False, ())


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


@pytest.mark.parametrize("mag_filter", [None, 9728, 9729])
def test_a_sampler_asks_for_the_nearest_texel(mag_filter: int | None) -> None:
    sampler = {} if mag_filter is None else {"magFilter": mag_filter}
    (part,) = Model(TEXCOORD_0=UV).texture(**sampler).read().parts
    assert part.texture.is_nearest == (mag_filter == 9728)


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
def test_factors_and_vertex_colours_are_linear(color: np.ndarray) -> None:
    model = Model()
    model.primitive["attributes"]["COLOR_0"] = model.add(np.tile(color, (4, 1)), normalized=True)
    model.material["pbrMetallicRoughness"] = {"baseColorFactor": [0.2, 0.2, 1, 1]}
    (part,) = model.read().parts
    curve = encode_srgb(np.array([0.2, 128 / 255 if color.dtype == np.uint8 else 0.5]))
    assert part.is_linear
    lit = [*decode_srgb(np.array([curve[0] * curve[1] * FRONT, curve[0] * FRONT, 0])), 1]
    assert part.colors[0] == pytest.approx(lit, abs=1e-6)


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


GLOSSY = "KHR_materials_pbrSpecularGlossiness"


@pytest.mark.parametrize(
    ("diffuse", "specular", "expected"),
    [
        ([0, 0, 0, 1], [1, 0.5, 0.3], [1, 0.5, 0.3]),
        ([0.4, 0, 0, 1], [0.3, 0.3, 0.3], [0.4, 0.3, 0.3]),
        ([1, 0, 0, 1], [0.04, 0.04, 0.04], [1, 0, 0]),  # no metal
    ],
)
def test_a_metal_has_its_specular_colour(diffuse: list[float], specular: list[float], expected: list[float]) -> None:
    model = Model()
    model.material["extensions"] = {GLOSSY: {"diffuseFactor": diffuse, "specularFactor": specular}}
    scene = model.read()
    assert scene.parts[0].colors[0, :3] == pytest.approx(encode_srgb(np.array(expected)) * FRONT)
    metal = (f"{GLOSSY}: metals are drawn in their specular colour",)
    assert scene.notes == (() if expected == diffuse[:3] else metal)


@pytest.mark.parametrize("mode", ["OPAQUE", "BLEND"])
@pytest.mark.parametrize("has_texture", [True, False])
def test_a_metal_whose_diffuse_colour_is_black_has_its_specular_texture(has_texture: bool, mode: str) -> None:
    model = Model(TEXCOORD_0=UV).texture(np.zeros_like(PIXELS))
    model.json["images"].append({"bufferView": model.view(encode_png(PIXELS))})
    model.json["textures"].append({"source": 1})
    diffuse = {"diffuseTexture": {"index": 0}} if has_texture else {"diffuseFactor": [0, 0, 0, 1]}
    model.material["extensions"] = {GLOSSY: diffuse | {"specularGlossinessTexture": {"index": 1}}}
    model.material["alphaMode"] = mode
    scene = model.read()
    (part,) = scene.parts
    assert part.texture.pixels[..., :3].tolist() == PIXELS[..., :3].tolist()
    assert part.texture.pixels[..., 3].min() == 255  # its fourth channel is glossiness
    assert part.colors[0] == pytest.approx([FRONT, FRONT, FRONT, 1])
    assert scene.notes[-1] == f"{GLOSSY}: metals are drawn in their specular colour"
    assert len(scene.notes) == 1 + (has_texture and mode == "BLEND")
    model.material["emissiveFactor"] = [0, 1, 0]  # a lamp of glass, but for one whose shape may be in a texture
    assert (model.read().parts[0].colors[0].tolist() == [0, 1, 0, 1]) != (has_texture and mode == "BLEND")


@pytest.mark.parametrize("values", [{"specularFactor": [1, 1, 1]}, {"specularGlossinessTexture": {"index": 0}}])
def test_specular_colours_beside_diffuse_textures_are_noted(values: dict[str, object]) -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.material["extensions"] = {GLOSSY: {"diffuseTexture": {"index": 0}} | values}
    scene = model.read()
    assert np.array_equal(scene.parts[0].texture.pixels[..., :3], PIXELS[..., :3])
    (note,) = scene.notes
    assert note.startswith(f"{GLOSSY}: specular colours in textures, or combined with textures, are left out, so")


def test_an_extension_without_values_replaces_the_base_colour() -> None:
    model = Model()
    model.material |= {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}, "extensions": {GLOSSY: {}}}
    assert model.read().parts[0].colors[0] == pytest.approx([FRONT, FRONT, FRONT, 1])


def test_a_material_that_only_emits_light_has_its_colour_and_texture() -> None:
    model = Model(TEXCOORD_0=UV, COLOR_0=np.full((4, 3), 0.25, np.float32)).texture()
    model.material["pbrMetallicRoughness"] = {"baseColorFactor": [0, 0, 0, 1]}
    model.material.update(emissiveFactor=[1, 1, 0], emissiveTexture={"index": 0})
    scene = model.read()
    (part,) = scene.parts
    assert (part.colors.tolist(), scene.notes) == ([[1, 1, 0, 1]] * 4, ())
    assert part.texture.pixels[..., :3].tolist() == PIXELS[..., :3].tolist()


@pytest.mark.parametrize(("mode", "alpha"), [("MASK", 0.75), ("BLEND", 0.75), ("OPAQUE", 1)])
def test_a_material_that_only_emits_light_keeps_its_alpha(mode: str, alpha: float) -> None:
    model = Model(TEXCOORD_0=UV).texture()
    texture = {"index": 0}
    model.material["pbrMetallicRoughness"] = {"baseColorFactor": [0, 0, 0, 0.75]}
    model.material.update(alphaMode=mode, emissiveFactor=[0, 1, 0])
    scene = model.read()
    assert (scene.parts[0].colors.tolist(), scene.notes) == ([[0, 1, 0, alpha]] * 4, ())
    model.material["emissiveTexture"] = texture  # whose alpha is no part of the light
    assert model.read().parts[0].texture.pixels[..., 3].min() == 255
    model.material["pbrMetallicRoughness"]["baseColorTexture"] = texture
    scene = model.read()
    assert scene.parts[0].texture.pixels[..., 3].min() == (255 if mode == "OPAQUE" else 0)
    assert scene.notes == ()
    del model.material["emissiveTexture"]
    scene = model.read()  # the light has no texture, but the shape may be in the base texture's alpha
    note = "light that a material emits is left out: its base colour is drawn"
    assert scene.notes == ((note,) if mode != "OPAQUE" else ())
    assert (scene.parts[0].texture is None) == (mode == "OPAQUE")


def test_a_black_texture_counts_as_black_where_a_material_emits_light() -> None:
    black = np.zeros_like(PIXELS)
    model = Model(TEXCOORD_0=UV).texture(black)
    model.material["emissiveFactor"] = [0, 1, 0]
    scene = model.read()
    assert (scene.parts[0].colors.tolist(), scene.notes) == ([[0, 1, 0, 1]] * 4, ())
    black[1, 1, 2] = 1
    model = Model(TEXCOORD_0=UV).texture(black)
    model.material["emissiveFactor"] = [0, 1, 0]
    assert model.read().notes == ("light that a material emits is left out: its base colour is drawn",)


@pytest.mark.parametrize(
    ("strength", "expected"), [(2, [0.5, 0.25, 0]), (8, [1, 0.5, 0]), (1e999, [1, 0.5, 0]), (-1, [0, 0, 0])]
)
def test_light_is_as_strong_as_the_extension_says_and_keeps_its_hue(strength: float, expected: list[float]) -> None:
    model = Model()
    model.material["pbrMetallicRoughness"] = {"baseColorFactor": [0, 0, 0, 1]}
    model.material["emissiveFactor"] = [0.25, 0.125, 0]
    model.material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    model.json["extensionsUsed"] = ["KHR_materials_emissive_strength"]
    scene = model.read()
    assert (scene.notes, scene.parts[0].colors[0, :3]) == ((), pytest.approx(encode_srgb(np.array(expected))))


@pytest.mark.parametrize("emitted", [[1, 1], [1, 1, 0, 1]])
def test_a_black_material_that_emits_too_few_or_too_many_numbers_is_drawn(emitted) -> None:
    model = Model()
    model.material["pbrMetallicRoughness"] = {"baseColorFactor": [0, 0, 0, 1]}
    model.material["emissiveFactor"] = emitted
    (part,) = model.read().parts
    assert part.colors[0, :3].tolist() == ([1, 1, 0] if len(emitted) == 4 else [0, 0, 0])


def test_light_that_a_material_emits_is_noted() -> None:
    model = Model()
    model.material["emissiveFactor"] = [0, 0, 0]
    assert model.read().notes == ()
    model.material["emissiveFactor"] = [0, 1, 0]
    assert model.read().notes == ("light that a material emits is left out: its base colour is drawn",)
    model.material["extensions"] = {"KHR_materials_unlit": {}}  # whose colour is the base colour alone
    assert model.read().notes == ()


def test_light_that_changes_nothing_is_noted() -> None:
    model, lit = Model(), Placement(light=(30.0, 20.0))
    model.material["extensions"] = {"KHR_materials_unlit": {}}
    bundle = Bundle("a.glb", "a.glb", {"a.glb": model.glb()})
    assert meshes.read(bundle, "a.glb", SUFFIXES[".glb"], placement=lit).notes == (UNLIT,)
    assert meshes.read(bundle, "a.glb", SUFFIXES[".glb"]).notes == ()
    model.material["extensions"] = {}
    bundle = Bundle("a.glb", "a.glb", {"a.glb": model.glb()})
    assert meshes.read(bundle, "a.glb", SUFFIXES[".glb"], placement=lit).notes == ()


def test_a_cutoff_above_1_leaves_nothing() -> None:
    model = Model()
    model.material |= {"alphaMode": "MASK", "alphaCutoff": 1.5}
    assert model.read().parts[0].alpha_cutoff == 1.5


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


@pytest.mark.parametrize(
    ("mode", "factor", "color", "alpha"),
    [
        ("OPAQUE", 1, [1, 1, 1, 0.5], 0.1),  # opaque: the colour's alpha plays no part
        ("BLEND", 1, [1, 1, 1, 0.5], 0.05),
        ("OPAQUE", 0.5, [1, 1, 1, 1], 0.55),
        ("OPAQUE", 1, [0, 1, 0, 1], 1 - 0.9 * 0.7152),
        ("OPAQUE", 0, [1, 1, 1, 1], 1.0),
        ("OPAQUE", float("nan"), [1, 1, 1, 1], 1.0),
        ("MASK", 1, [1, 1, 1, 0.8], 0.8),
    ],
)
def test_transmission_is_see_through(mode: str, factor: float, color: list[float], alpha: float) -> None:
    model = Model()
    model.material |= {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorFactor": color}}
    model.material["extensions"] = {"KHR_materials_transmission": {"transmissionFactor": factor}}
    model.json["extensionsUsed"] = ["KHR_materials_transmission"]
    scene = model.read()
    assert scene.parts[0].colors[:, 3] == pytest.approx(alpha)
    assert scene.is_see_through == (factor > 0 and mode != "MASK")
    assert len(scene.notes) == scene.is_see_through


def test_blend_keeps_the_alpha_of_a_texture() -> None:
    model = Model(TEXCOORD_0=UV).texture()
    model.material |= {"alphaMode": "BLEND"}
    (part,) = model.read().parts
    assert part.is_see_through
    assert np.array_equal(part.texture.pixels, PIXELS)


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


def test_colours_that_are_no_numbers_are_black() -> None:
    model = Model()
    model.material |= {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [float("nan"), 1e999, -1, 9]}}
    assert model.read().parts[0].colors[0] == pytest.approx([0, FRONT, 0, 1])


@pytest.mark.parametrize("is_normalised", [True, False])
def test_quantised_texture_coordinates_with_the_transform_that_undoes_it(is_normalised: bool) -> None:
    model = Model(TEXCOORD_0=np.zeros_like(UV)).texture()
    steps = (UV * 4095).astype(np.uint16)
    model.primitive["attributes"]["TEXCOORD_0"] = model.add(steps, normalized=is_normalised)
    scale = (65535 if is_normalised else 1) / 4095
    texture = model.material["pbrMetallicRoughness"]["baseColorTexture"]
    texture["extensions"] = {"KHR_texture_transform": {"scale": [scale, scale]}}
    model.json["extensionsUsed"] = ["KHR_mesh_quantization", "KHR_texture_transform"]
    (part,) = model.read().parts
    assert part.uv == pytest.approx(np.stack([UV[:, 0], 1 - UV[:, 1]], axis=1), abs=1e-6)


def test_material_variants_are_noted() -> None:
    model = Model()
    model.json["extensionsUsed"] = ["KHR_materials_variants"]
    assert model.read().notes == ("KHR_materials_variants: the materials without a variant are drawn",)


def test_materials_whose_backs_differ_are_parts_of_their_own() -> None:
    model = Model()
    model.material["extensions"] = {"KHR_materials_unlit": {}}
    model.json["materials"].append({"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True})
    model.json["meshes"][0]["primitives"].append(model.primitive | {"material": 1})
    assert [part.hides_back for part in model.read().parts] == [True, False]
