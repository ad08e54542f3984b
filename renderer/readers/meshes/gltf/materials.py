"""glTF materials: base colours and their textures (glTF 2.0, sections 3.8 and 3.9)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.readers.meshes.geometry import normalise
from ciir.renderer.shading import encode_srgb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document
    from ciir.renderer.scene import Texture, Wrap
    from ciir.renderer.surface import Back

_NEAREST = 9728
_WRAPS: dict[int, Wrap] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}

TRANSMITTED = 0.9
"""The largest share of light from behind that clear glass lets through. The rest stands for its reflections."""
METAL = 0.25
"""The largest linear specular colour of a material that is not a metal: gems have 0.17, metals 0.5 and more."""
_MAX_STRENGTH = 1e6
"""The largest `emissiveStrength`. JSON may contain larger values; they count as this one."""


class Material:
    """The colour of a primitive's material."""

    def __init__(self, document: Document, index: int | None) -> None:
        entry = {} if index is None else document.item("materials", index)
        self._document = document
        self.extensions: dict[str, Any] = entry.get("extensions", {})
        metallic = entry.get("pbrMetallicRoughness", {})
        glossy = self.extensions.get("KHR_materials_pbrSpecularGlossiness")
        factor = metallic.get("baseColorFactor") if glossy is None else glossy.get("diffuseFactor")
        linear = _read_linear(factor or (1, 1, 1, 1))
        red, green, blue = (float(value) for value in encode_srgb(linear[:3]))
        self.color = red, green, blue, float(np.clip(linear[3], 0.0, 1.0))
        self._take_texture(metallic.get("baseColorTexture") if glossy is None else glossy.get("diffuseTexture"))
        mode, self.alpha_cutoff = entry.get("alphaMode", "OPAQUE"), None
        self._has_alpha = self._texture_has_alpha = mode != "OPAQUE"
        self.is_unlit = "KHR_materials_unlit" in self.extensions
        emitted = self._read_emitted(entry)
        emits = not self.is_unlit and bool(emitted.any())
        glow = entry.get("emissiveTexture")
        is_cut = self._has_alpha and self._texture not in (None, glow)  # the base texture's alpha holds its shape
        self.only_emits = emits and len(emitted) == 3 and not is_cut and self._is_black()
        """Whether it is black except for the light that it emits, whose colour and texture are then its own, unlit."""
        if self.only_emits:
            self._replace(emitted, glow)
            self.is_unlit = True
        else:
            if glossy is not None:
                self._take_specular(glossy, linear[:3])
            if emits:
                document.resolver.add_note("light that a material emits is left out: its base colour is drawn")
        if mode == "MASK":
            self.alpha_cutoff = max(float(entry.get("alphaCutoff", 0.5)), 0.0)  # above 1 nothing is visible
        self.back: Back = "lit" if entry.get("doubleSided") is True else "hidden"
        transmitted = self._transmitted()
        self.is_see_through = mode == "BLEND" or transmitted > 0
        if transmitted:
            self.color = *self.color[:3], (self.color[3] if self._has_alpha else 1.0) * (1 - transmitted)

    def _take_texture(self, texture: dict[str, Any] | None) -> None:
        self._texture: Any = texture
        self._transform: dict[str, Any] = (texture or {}).get("extensions", {}).get("KHR_texture_transform", {})
        channel = self._transform.get("texCoord", (texture or {}).get("texCoord", 0))
        self.texcoord = "" if texture is None else f"TEXCOORD_{channel}"
        """The attribute that holds the texture's coordinates; empty if there is no texture."""

    def _take_specular(self, glossy: dict[str, Any], diffuse: NDArray[np.float64]) -> None:
        """Replaces the diffuse colour of a metal, which is black, with its specular colour, and adds a note."""
        texture = glossy.get("specularGlossinessTexture")
        # The default specular colour is a mirror's: a file that leaves it out must mean its diffuse colour.
        specular = _read_linear(glossy.get("specularFactor", (0, 0, 0) if texture is None else (1, 1, 1)))
        if specular.max(initial=0) <= METAL:
            return
        if self._is_black():
            self._replace(specular, texture)
        elif texture is None and self._texture is None:
            self._replace(np.maximum(diffuse, specular), None)
        else:
            self._document.resolver.add_note(
                "KHR_materials_pbrSpecularGlossiness: specular colours in textures, or combined with textures, are "
                "left out, so metals may be dark; export it with metallic-roughness materials"
            )
            return
        self._document.resolver.add_note(
            "KHR_materials_pbrSpecularGlossiness: metals are drawn in their specular colour"
        )

    def _read_emitted(self, entry: dict[str, Any]) -> NDArray[np.float64]:
        """Reads the emitted light, linear. Light over 1 is scaled down, so that its hue stays the same."""
        given = self.extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        strength = float(np.clip(np.nan_to_num(float(given)), 0.0, _MAX_STRENGTH))
        emitted = np.clip(_read_linear(entry.get("emissiveFactor", (0, 0, 0)))[:3], 0.0, 1.0) * strength
        brightest: NDArray[np.float64] = emitted / max(1.0, emitted.max(initial=0.0))
        return brightest

    def _replace(self, color: NDArray[np.float64], texture: dict[str, Any] | None) -> None:
        """Replaces the base colour, except for its alpha, with a linear one, and replaces the texture."""
        red, green, blue = (float(value) for value in encode_srgb(color))
        self.color = red, green, blue, self.color[3]
        if self._has_alpha and self._texture != texture:  # only the fourth channel of a base texture is alpha
            self._texture_has_alpha = False
            if self._texture is not None:
                self._document.resolver.add_note(
                    "the alpha of a black texture is left out: the specular colour is drawn instead"
                )
        self._take_texture(texture)

    def _is_black(self) -> bool:
        """Checks whether the base colour or its texture is black everywhere."""
        if self._texture is None or not any(self.color[:3]):
            return not any(self.color[:3])
        known, index = self._document.black_textures, self._texture["index"]
        if index not in known:
            texture = self._read()
            known[index] = texture is not None and not texture.pixels[..., :3].any()
        return known[index]

    def _transmitted(self) -> float:
        """Returns the share of light from behind that `KHR_materials_transmission` lets through, and adds a note."""
        transmission = self.extensions.get("KHR_materials_transmission", {})
        factor = min(float(transmission.get("transmissionFactor", 0.0)), 1.0)
        if not factor > 0 or self.alpha_cutoff is not None:  # NaN too
            return 0.0
        self._document.resolver.add_note(
            "KHR_materials_transmission is drawn as transparency without refraction; darker colours hide more"
        )
        luma = 0.2126 * self.color[0] + 0.7152 * self.color[1] + 0.0722 * self.color[2]
        return TRANSMITTED * factor * luma

    def texture(self, arrays: dict[str, NDArray[Any]]) -> tuple[Texture | None, NDArray[np.float64] | None]:
        """Returns the base colour's texture, and its coordinates `(n, 2)` with the origin at the lower left."""
        if self.texcoord not in arrays:
            if self._texture is not None:
                self._document.resolver.add_note("a texture without texture coordinates is left out")
            return None, None
        uv = arrays[self.texcoord]
        # Without the extension integers are normalised, even if the accessor doesn't say so.
        if "KHR_mesh_quantization" not in self._document.json.get("extensionsUsed", ()):
            uv = normalise(uv)
        uv = uv.astype(np.float64)
        uv = _transform_uv(uv, self._transform)
        return self._read(), np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)

    def _read(self) -> Texture | None:
        document = self._document
        entry = document.item("textures", self._texture["index"])
        source = _find_source(entry)
        if source is None:
            document.resolver.add_note("a texture that is not PNG, JPEG, WebP or KTX2 is left out; export it as PNG")
            return None
        sampler = document.item("samplers", entry["sampler"]) if "sampler" in entry else {}
        image = document.item("images", source)
        if "bufferView" not in image and "uri" not in image:
            document.resolver.add_note(f"texture image {source} is left out: it has no data; export it again")
            return None
        uri = image.get("uri", "")
        embedded = "bufferView" in image or uri.startswith("data:")
        return document.resolver.decode_texture(
            lambda: document.image(image),
            key=f"buffer view {image['bufferView']}" if "bufferView" in image else uri,
            name=f"image {source}" if embedded else uri,
            opaque=not self._texture_has_alpha,
            wrap_u=_WRAPS.get(sampler.get("wrapS", 10497), "repeat"),
            wrap_v=_WRAPS.get(sampler.get("wrapT", 10497), "repeat"),
            is_nearest=sampler.get("magFilter") == _NEAREST,
        )


def _read_linear(factor: Any) -> NDArray[np.float64]:
    """Reads a colour of the file. NaN, which Python's JSON parser accepts, becomes 0."""
    return np.nan_to_num(np.array(factor, np.float64))


def _find_source(texture: dict[str, Any]) -> Any:
    """Returns the index of a texture's image: WebP first, Basis Universal last: it is lossy and may need a package."""
    extensions = texture.get("extensions", {})
    places = extensions.get("EXT_texture_webp", {}), texture, extensions.get("KHR_texture_basisu", {})
    return next((place["source"] for place in places if "source" in place), None)


def _transform_uv(uv: NDArray[np.float64], transform: dict[str, Any]) -> NDArray[np.float64]:
    """Applies KHR_texture_transform to glTF's coordinates (origin at upper left): offset + rotation x scale x uv."""
    scaled = uv * np.array(transform.get("scale", (1, 1)), np.float64)
    angle = float(transform.get("rotation", 0.0))
    # Counter-clockwise with v pointing down, as in sample models and viewers; the extension's GLSL is clockwise
    # (KhronosGroup/glTF issue 1563).
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned: NDArray[np.float64] = scaled @ rotation.T + np.array(transform.get("offset", (0, 0)), np.float64)
    return turned
