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
"""Most of the light from behind that comes through clear glass: the rest stands for its reflections."""


class Material:
    """The colour of a primitive's material."""

    def __init__(self, document: Document, index: int | None) -> None:
        entry = {} if index is None else document.item("materials", index)
        self._document = document
        self.extensions: dict[str, Any] = entry.get("extensions", {})
        metallic = entry.get("pbrMetallicRoughness", {})
        glossy = self.extensions.get("KHR_materials_pbrSpecularGlossiness", {})
        factor = glossy.get("diffuseFactor") if glossy else metallic.get("baseColorFactor")
        linear = np.nan_to_num(np.array(factor or (1.0, 1.0, 1.0, 1.0), np.float64))  # JSON as Python reads it has NaN
        red, green, blue = (float(value) for value in encode_srgb(linear[:3]))
        self.color = red, green, blue, float(np.clip(linear[3], 0.0, 1.0))
        self._take_texture(glossy.get("diffuseTexture") if glossy else metallic.get("baseColorTexture"))
        mode, self.alpha_cutoff = entry.get("alphaMode", "OPAQUE"), None
        self.is_unlit = "KHR_materials_unlit" in self.extensions
        emitted = np.nan_to_num(np.array(entry.get("emissiveFactor", (0.0, 0.0, 0.0)), np.float64))[:3]
        emits = not self.is_unlit and bool((emitted > 0).any())
        self.only_emits = emits and mode == "OPAQUE" and len(emitted) == 3 and not any(self.color[:3])
        """Whether it is black but for the light that it emits, whose colour and texture are then its own, unlit."""
        if self.only_emits:
            red, green, blue = (float(value) for value in encode_srgb(emitted))
            self.color, self.is_unlit = (red, green, blue, self.color[3]), True
            self._take_texture(entry.get("emissiveTexture"))
        elif emits:
            document.resolver.add_note("light that a material emits is left out: its base colour is drawn")
        if mode == "MASK":
            self.alpha_cutoff = min(max(float(entry.get("alphaCutoff", 0.5)), 0.0), 1.0)
        self._has_alpha = mode != "OPAQUE"
        self.back: Back = "lit" if entry.get("doubleSided") is True else "hidden"
        transmitted = self._transmitted()
        self.is_see_through = mode == "BLEND" or transmitted > 0
        if transmitted:
            self.color = red, green, blue, (self.color[3] if self._has_alpha else 1.0) * (1 - transmitted)

    def _take_texture(self, texture: dict[str, Any] | None) -> None:
        self._texture: Any = texture
        self._transform: dict[str, Any] = (texture or {}).get("extensions", {}).get("KHR_texture_transform", {})
        channel = self._transform.get("texCoord", (texture or {}).get("texCoord", 0))
        self.texcoord = "" if texture is None else f"TEXCOORD_{channel}"
        """The attribute that holds the texture's coordinates; empty without a texture."""

    def _transmitted(self) -> float:
        """The share of the light from behind that `KHR_materials_transmission` lets through, with a note."""
        transmission = self.extensions.get("KHR_materials_transmission", {})
        factor = min(float(transmission.get("transmissionFactor", 0.0)), 1.0)
        if not factor > 0 or self.alpha_cutoff is not None:  # NaN too
            return 0.0
        self._document.resolver.add_note(
            "KHR_materials_transmission is drawn as see-through, darker colours as hiding more; without refraction"
        )
        luma = 0.2126 * self.color[0] + 0.7152 * self.color[1] + 0.0722 * self.color[2]
        return TRANSMITTED * factor * luma

    def texture(self, arrays: dict[str, NDArray[Any]]) -> tuple[Texture | None, NDArray[np.float64] | None]:
        """The base colour's texture, and its coordinates `(n, 2)` with the origin at the lower left."""
        if self.texcoord not in arrays:
            if self._texture is not None:
                self._document.resolver.add_note("a texture without texture coordinates is left out")
            return None, None
        uv = arrays[self.texcoord]
        # Without the extension integers are normalised, whether the accessor says so or not.
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
            document.resolver.add_note("a texture that is no PNG, JPEG, WebP or KTX2 is left out; export it as one")
            return None
        sampler = document.item("samplers", entry["sampler"]) if "sampler" in entry else {}
        image = document.item("images", source)
        uri = image.get("uri", "")
        embedded = "bufferView" in image or uri.startswith("data:")
        return document.resolver.decode_texture(
            lambda: document.image(image),
            key=f"buffer view {image['bufferView']}" if "bufferView" in image else uri,
            name=f"image {source}" if embedded else uri,
            opaque=not self._has_alpha,
            wrap_u=_WRAPS.get(sampler.get("wrapS", 10497), "repeat"),
            wrap_v=_WRAPS.get(sampler.get("wrapT", 10497), "repeat"),
            is_nearest=sampler.get("magFilter") == _NEAREST,
        )


def _find_source(texture: dict[str, Any]) -> Any:
    """The number of a texture's image: WebP first, Basis Universal last, since that is lossy and may need a package."""
    extensions = texture.get("extensions", {})
    places = extensions.get("EXT_texture_webp", {}), texture, extensions.get("KHR_texture_basisu", {})
    return next((place["source"] for place in places if "source" in place), None)


def _transform_uv(uv: NDArray[np.float64], transform: dict[str, Any]) -> NDArray[np.float64]:
    """KHR_texture_transform on glTF's own coordinates (origin at the upper left): offset + rotation x scale x uv."""
    scaled = uv * np.array(transform.get("scale", (1, 1)), np.float64)
    angle = float(transform.get("rotation", 0.0))
    # Counter-clockwise where v goes down, as sample models and viewers have it; the extension's GLSL is clockwise
    # (KhronosGroup/glTF issue 1563).
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned: NDArray[np.float64] = scaled @ rotation.T + np.array(transform.get("offset", (0, 0)), np.float64)
    return turned
