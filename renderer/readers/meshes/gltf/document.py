"""glTF 2.0 files: the container, its JSON, the buffers, and the extensions that can be decoded here.

trimesh 5.2 is not used. Without an error it ignores a sampler's wraps, a texture's transform, the vertex colours of
textured meshes and required extensions, and reads accessors without data as zeros. The format is described in Khronos
glTF 2.0, sections 3 and 4.
"""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from ciir.errors import TooLarge, Unreadable, UnsupportedType, advise_extra
from ciir.renderer.readers.meshes.gltf import meshopt
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from ciir.renderer.readers.meshes.texture_files import Resolver

DECODED = {
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "KHR_texture_transform",
}
"""Extensions that are decoded here."""
_JSON_CHUNK, _BIN_CHUNK = 0x4E4F534A, 0x004E4942
_VIEW_INDEPENDENT = {"KHR_animation_pointer", "KHR_lights_punctual"}
ELEMENTS = 15
"""The most elements in all accessors that are read, for each triangle that a mesh may have. The largest mesh needs them
for positions, normals, colours, texture coordinates and indices. The limit is needed because an accessor without data
adds nothing to the file's size."""
ELEMENT_BYTES = 16
"""The bytes that count as one of the `ELEMENTS` in buffer views that are decompressed."""


@dataclass(eq=False)
class Document:
    """A glTF file's JSON and the data that it refers to."""

    name: str
    json: dict[str, Any]
    """The JSON as in the file. It is an object; nothing else is checked."""
    binary: bytes | None
    """The GLB's second chunk."""
    resolver: Resolver
    max_elements: int
    """The most elements in all accessors that are read."""
    buffers: dict[int, bytes] = field(default_factory=dict)
    """The buffers that were read, by index."""
    elements: int = 0
    """The number of elements in all accessors that were read."""
    unpacked: dict[object, memoryview] = field(default_factory=dict)
    """The buffer views that were decompressed, by index."""
    unpacked_bytes: int = 0
    """The total size of the decompressed buffer views."""
    black_textures: dict[int, bool] = field(default_factory=dict)
    """Whether a texture is black everywhere, by index. Only textures that were checked have an entry."""

    def item(self, kind: str, index: object) -> dict[str, Any]:
        """Returns the object `json[kind][index]`. Raises `Unreadable` if there is none."""
        items = self.json.get(kind, [])
        if not isinstance(index, int) or not isinstance(items, list) or not 0 <= index < len(items):
            raise Unreadable(
                f"{self.name}: names {kind} {clean_text(repr(index))}, which it doesn't have; export it again"
            )
        item = items[index]
        if not isinstance(item, dict):
            raise Unreadable(f"{self.name}: {kind} {index} is not an object; export it again")
        return item

    def buffer(self, index: int) -> bytes:
        """Returns the bytes of a buffer, at least `byteLength` of them."""
        if index in self.buffers:
            return self.buffers[index]
        entry = self.item("buffers", index)
        uri = entry.get("uri")
        if uri is None:
            data = self.binary if index == 0 else None
            if data is None:
                raise Unreadable(f"{self.name}: buffer {index} has no data; export it again")
        else:
            data = _decode_data_uri(uri, self.name)
            if data is None:
                data = self._find_file(uri)
            if data is None:
                why, remedy = self.resolver.explain_missing(unquote(uri))
                raise Unreadable(
                    f"{self.name}: buffer {clean_text(unquote(uri))} {why}; {remedy}, or export one .glb file"
                )
        if len(data) < int(entry["byteLength"]):
            raise Unreadable(f"{self.name}: buffer {index} is cut short; export it again")
        self.buffers[index] = data
        return data

    def view(self, index: object) -> memoryview:
        """Returns the bytes of a buffer view, decompressed."""
        entry = self.item("bufferViews", index)
        extensions = entry.get("extensions", {})
        packed = next((extensions[name] for name in meshopt.NAMES if name in extensions), None)
        stored = entry if packed is None else packed
        data = self.buffer(stored["buffer"])
        start, length = int(stored.get("byteOffset", 0)), int(stored["byteLength"])
        if start < 0 or length < 0 or start + length > len(data):
            raise Unreadable(f"{self.name}: buffer view {index} ends beyond its buffer; export it again")
        found = memoryview(data)[start : start + length]
        if packed is None:
            return found
        if index not in self.unpacked:
            self.unpacked[index] = self._unpack(found, packed, index)
        return self.unpacked[index]

    def _unpack(self, data: memoryview, packed: dict[str, Any], index: object) -> memoryview:
        """Decompresses a buffer view with one of the extensions `meshopt.NAMES`. Raises `Unreadable`, or `TooLarge`
        before anything is allocated."""
        count, stride = int(packed["count"]), int(packed["byteStride"])
        most = ELEMENT_BYTES * self.max_elements
        self.unpacked_bytes += count * stride
        if self.unpacked_bytes > most:
            raise TooLarge(
                f"{self.name}: with buffer view {index} the compressed buffer views unpack to over {most:,} bytes; "
                "decimate the mesh",
                "triangles",
            )
        mode, filter_ = str(packed["mode"]), str(packed.get("filter", "NONE"))
        try:
            values = meshopt.decode(bytes(data), count=count, stride=stride, mode=mode, filter_=filter_)
        except MemoryError:  # the server's, not the file's
            raise
        except Exception as error:
            raise Unreadable(f"{self.name}: buffer view {index} has corrupt meshopt data; export it again") from error
        return memoryview(values.tobytes())

    def image(self, entry: dict[str, Any]) -> bytes | None:
        """Returns the bytes of an entry of `images`. Returns None and adds a note if its file is missing."""
        if "bufferView" in entry:
            return bytes(self.view(entry["bufferView"]))
        data = _decode_data_uri(entry["uri"], self.name)
        if data is None:
            data = self._find_file(entry["uri"])
        return self.resolver.find_or_note(unquote(entry["uri"]), "texture") if data is None else data

    def _find_file(self, uri: str) -> bytes | None:
        """Finds the file that a URI names. Some exporters don't quote `%` in names."""
        data = self.resolver.find(unquote(uri))
        return self.resolver.find(uri) if data is None and "%" in uri else data


def parse(data: bytes, *, name: str, resolver: Resolver, max_triangles: int) -> Document:
    """Parses a `.glb` or `.gltf` file and checks that its required extensions can be decoded.

    Raises `Unreadable` if the container or its JSON is malformed, and `UnsupportedType` for other versions of glTF and
    for required extensions that are not decoded here.
    """
    text, binary = _split_chunks(data, name) if data.startswith(b"glTF") else (data, None)
    try:
        document = json.loads(text.decode("utf-8-sig"))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise Unreadable(f"{name}: its JSON can't be read ({clean_text(str(error))}); export it again") from error
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        raise Unreadable(f"{name}: JSON without an asset: not a glTF file; export it again")
    version = str(document["asset"].get("version"))
    if version.partition(".")[0] != "2":
        raise UnsupportedType(f"{name}: glTF version {clean_text(version)}; version 2.0 is read; export it as glTF 2.0")
    required = [str(extension) for extension in document.get("extensionsRequired", [])]
    for extension in dict.fromkeys(required + [str(used) for used in document.get("extensionsUsed", [])]):
        _check_extension(extension, name, resolver, is_required=extension in required)
    return Document(name, document, binary, resolver, ELEMENTS * max_triangles)


def _decode_data_uri(uri: str, name: str) -> bytes | None:
    """Returns the data of a data URI, or None if the URI names a file."""
    if not uri.startswith("data:"):
        return None
    header, _, payload = uri.partition(",")
    if not header.endswith(";base64"):
        raise Unreadable(f"{name}: a data URI is not base64; export it again")
    return base64.b64decode(payload + "==")  # too much padding is ignored, too little is not


def _check_extension(extension: str, name: str, resolver: Resolver, *, is_required: bool) -> None:
    """Adds a note on an extension that has no effect here. Raises `UnsupportedType` if the file requires it."""
    if extension in DECODED:
        if extension == "KHR_texture_basisu" and is_required and find_spec("opengl_basisu") is None:
            raise UnsupportedType(
                f"{name}: requires {extension}, which opengl-basisu decodes; run {advise_extra('basisu')}, or "
                "export it with PNG, JPEG or WebP textures"
            )
        return
    named = clean_text(extension)
    if extension == "KHR_materials_variants":
        resolver.add_note(f"{named}: the materials without a variant are drawn")
    elif extension.startswith("KHR_materials_") or extension in _VIEW_INDEPENDENT:
        resolver.add_note(f"{named} has no effect on a view-independent picture and is ignored")
    elif is_required:
        raise UnsupportedType(
            f"{name}: requires the extension {named}, which is not decoded here; export it again without it"
        )
    else:
        resolver.add_note(f"the extension {named} is not decoded here: what it adds is left out")


def _split_chunks(data: bytes, name: str) -> tuple[bytes, bytes | None]:
    if len(data) < 20:
        raise Unreadable(f"{name}: a GLB of {len(data)} bytes is cut short; export it again")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise UnsupportedType(f"{name}: GLB version {version}; version 2 is read; export it as glTF 2.0")
    if length > len(data):
        raise Unreadable(f"{name}: cut short: it has {len(data):,} of {length:,} bytes; give it again")
    chunks: dict[int, bytes] = {}
    start = 12
    while start + 8 <= length:
        size, kind = struct.unpack_from("<II", data, start)
        if start + 8 + size > length:
            raise Unreadable(f"{name}: a GLB chunk ends beyond the file; export it again")
        chunks.setdefault(kind, data[start + 8 : start + 8 + size])
        start += 8 + size
    if _JSON_CHUNK not in chunks:
        raise Unreadable(f"{name}: a GLB without a JSON chunk; export it again")
    return chunks[_JSON_CHUNK], chunks.get(_BIN_CHUNK)
