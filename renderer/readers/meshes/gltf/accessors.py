"""glTF accessors as arrays (glTF 2.0, section 3.6)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.readers.meshes.geometry import normalise
from ciir.renderer.readers.meshes.polygons import triangulate_fans
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document

_TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}  # a matrix column by column
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def read_accessor(document: Document, index: object) -> NDArray[Any]:
    """Reads an accessor as `(count, width)`: as its own integers, or as float32 if it holds floats or is normalised.

    Raises `Unreadable` if it needs more data than the file holds, and `TooLarge` if all accessors together exceed
    `Document.max_elements`.
    """
    entry = document.item("accessors", index)
    dtype = np.dtype(_TYPES[entry["componentType"]]).newbyteorder("<")
    width, count = _WIDTHS[entry["type"]], int(entry["count"])
    many = clean_text(f"{count:,}")
    if count < 0:
        raise Unreadable(f"{document.name}: accessor {index} counts {many} elements; export it again")
    document.elements += count + (int(entry["sparse"]["count"]) if "sparse" in entry else 0)
    if document.elements > document.max_elements:
        raise TooLarge(
            f"{document.name}: with accessor {index} the accessors have {clean_text(f'{document.elements:,}')} "
            f"elements; at most {document.max_elements:,} are read together; decimate the mesh",
            "triangles",
            sum(int(each["count"]) for each in document.json["accessors"]) // 3,  # a triangle has 3 indices alone
        )
    if "bufferView" in entry:
        view = document.item("bufferViews", entry["bufferView"])
        values = _read_strided(
            document.view(entry["bufferView"]),
            dtype,
            (count, width),
            int(entry.get("byteOffset", 0)),
            int(view.get("byteStride", 0)),
            what=f"{document.name}: accessor {index}",
        )
    else:
        values = np.zeros((count, width), dtype)
    if "sparse" in entry:
        values = _replace_sparse(document, entry["sparse"], values, f"{document.name}: accessor {index}")
    return normalise(values) if entry.get("normalized") else values


def make_triangles(indices: NDArray[Any], mode: int) -> NDArray[np.int64]:
    """Makes triangles `(m, 3)` from the indices `(n,)` of a primitive of `mode` 4, 5 or 6."""
    flat = indices.astype(np.int64).ravel()
    if mode == _TRIANGLES:
        return flat[: len(flat) // 3 * 3].reshape(-1, 3)
    if len(flat) < 3:
        return np.empty((0, 3), np.int64)
    if mode == _FAN:
        return flat[triangulate_fans(np.array([len(flat)]))[0]]
    if mode != _STRIP:
        raise ValueError(f"primitive mode {mode}")
    strip = np.stack([flat[:-2], flat[1:-1], flat[2:]], axis=1)
    strip[1::2] = strip[1::2, [0, 2, 1]]
    return strip


def _read_strided(
    data: memoryview, dtype: np.dtype[Any], shape: tuple[int, int], offset: int, stride: int, *, what: str
) -> NDArray[Any]:
    count, width = shape
    stride = stride or dtype.itemsize * width
    end = offset + (stride * (count - 1) + dtype.itemsize * width if count else 0)
    if offset < 0 or stride < 0 or end > len(data):
        raise Unreadable(f"{what} ends beyond its buffer view; export it again")
    return np.ndarray(shape, dtype, data, offset, (stride, dtype.itemsize))


def _replace_sparse(document: Document, sparse: dict[str, Any], values: NDArray[Any], what: str) -> NDArray[Any]:
    count = int(sparse["count"])
    at, new = sparse["indices"], sparse["values"]
    dtype = np.dtype(_TYPES[at["componentType"]]).newbyteorder("<")
    offsets = int(at.get("byteOffset", 0)), int(new.get("byteOffset", 0))
    rows = _read_strided(document.view(at["bufferView"]), dtype, (count, 1), offsets[0], 0, what=what)[:, 0]
    replaced = values.copy()
    shape = (count, values.shape[1])
    replaced[rows] = _read_strided(document.view(new["bufferView"]), values.dtype, shape, offsets[1], 0, what=what)
    return replaced
