"""Decodes buffer views of EXT_meshopt_compression and KHR_meshopt_compression (appendices A and B of both).

imagecodecs decodes attributes. It has only meshoptimizer's vertex decoder, so indices and filters are decoded here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

NAMES = ("KHR_meshopt_compression", "EXT_meshopt_compression")
_TRIANGLES, _INDICES = 0xE1, 0xD1  # first bytes
_TABLE_BYTES, _PADDING_BYTES = 16, 4  # last bytes
_MOST_STRIDE = 256
_UNSET = 0xFFFFFFFF  # no vertex: a stream that reads it is refused, because this vertex doesn't exist


def decode(data: bytes, *, count: int, stride: int, mode: str, filter_: str) -> NDArray[Any]:
    """Decodes `count` elements of `stride` bytes. Raises any type of error if the data is corrupt."""
    if count < 1:
        raise ValueError("meshopt data of no elements")
    if mode == "ATTRIBUTES":
        if stride % 4 or not 0 < stride <= _MOST_STRIDE:  # imagecodecs divides by the stride, and has no room for more
            raise ValueError("meshopt attributes of a wrong stride")
        import imagecodecs

        rows: NDArray[np.uint8] = imagecodecs.meshopt_decode(data, (count, stride), np.uint8)
        return rows if filter_ == "NONE" else FILTERS[filter_](rows)
    indices = {"TRIANGLES": decode_triangles, "INDICES": decode_indices}[mode](data, count)
    return indices.astype({2: "<u2", 4: "<u4"}[stride])


def decode_triangles(data: bytes, count: int) -> NDArray[np.uint32]:
    """Decodes `count` indices of triangles from a stream of mode TRIANGLES."""
    triangles = count // 3
    start, table = 1 + triangles, data[-_TABLE_BYTES:]
    if data[0] != _TRIANGLES or count % 3 or len(data) < start + _TABLE_BYTES:
        raise ValueError("meshopt triangles are corrupt")
    extra = iter(data[start:-_TABLE_BYTES])
    found = np.empty((triangles, 3), np.uint32)
    edges, vertices = [(_UNSET, _UNSET)] * 16, [_UNSET] * 16  # rings; the newest entry is before `edge` and `vertex`
    edge = vertex = following = last = 0

    def read_index() -> int:
        nonlocal last
        last = (last + _unzigzag(_read_varint(extra))) & 0xFFFFFFFF
        return last

    def choose(nibble: int) -> tuple[int, bool]:
        """Returns a corner, and whether it is new to the ring of vertices."""
        nonlocal following
        if nibble == 0:
            following += 1
            return following - 1, True
        if nibble == 15:
            return read_index(), True
        return vertices[(vertex - nibble) & 15], False

    for number, code in enumerate(data[1:start]):
        high, low = code >> 4, code & 15
        if high < 15:
            a, b = edges[(edge - 1 - high) & 15]
            is_new = True
            if low == 0:
                c = following
                following += 1
            elif low < 13:
                c, is_new = vertices[(vertex - 1 - low) & 15], False
            elif low == 15:
                c = read_index()
            else:
                c = last = (last + (1 if low == 14 else -1)) & 0xFFFFFFFF
            new_edges: tuple[tuple[int, int], ...] = (c, b), (a, c)
            new_vertices: tuple[int, ...] = (c,) if is_new else ()
        else:
            pair = table[low] if low < 14 else next(extra)
            if low >= 14 and pair == 0:
                following = 0
            a, _ = choose(15 if low == 15 else 0)
            b, is_new_b = choose(pair >> 4)
            c, is_new_c = choose(pair & 15)
            new_edges = (b, a), (c, b), (a, c)
            new_vertices = (a, *((b,) if is_new_b else ()), *((c,) if is_new_c else ()))
        found[number] = a, b, c
        for pushed in new_edges:
            edges[edge & 15] = pushed
            edge += 1
        for corner in new_vertices:
            vertices[vertex & 15] = corner
            vertex += 1
    return found.ravel()


def _read_varint(data: Iterator[int]) -> int:
    """Reads an unsigned LEB128 number of up to five bytes."""
    value = 0
    for shift in range(0, 35, 7):
        byte = next(data)
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value
    raise ValueError("a number of meshopt data has over five bytes")


def _unzigzag(value: int) -> int:
    return ~(value >> 1) if value & 1 else value >> 1


def decode_indices(data: bytes, count: int) -> NDArray[np.uint32]:
    """Decodes `count` indices from a stream of mode INDICES: differences to the last index of one of two sequences."""
    stored = np.frombuffer(data, np.uint8)[1:-_PADDING_BYTES].astype(np.int64)
    ends = np.flatnonzero(stored < 0x80)  # of the LEB128 numbers
    starts = np.concatenate([[0], ends[:-1] + 1])
    if data[0] != _INDICES or len(ends) != count or (ends - starts).max(initial=0) > 4:
        raise ValueError("meshopt indices are corrupt")
    if not count:
        return np.empty(0, np.uint32)
    place = np.arange(ends[-1] + 1) - np.repeat(starts, ends + 1 - starts)
    values = np.add.reduceat((stored[: ends[-1] + 1] & 0x7F) << 7 * place, starts)
    steps = np.where(values & 2, ~(values >> 2), values >> 2)
    found = np.empty(count, np.int64)
    for sequence in (0, 1):
        of_sequence = (values & 1) == sequence
        found[of_sequence] = np.cumsum(steps[of_sequence])
    return found.astype(np.uint32)  # modulo 2**32


def _filter_octahedral(rows: NDArray[np.uint8]) -> NDArray[Any]:
    """Decodes unit vectors from octahedral coordinates x, y. The third component holds 1.0, the fourth is kept."""
    stored = rows.view(f"<i{rows.shape[1] // 4}")  # (n, 4)
    x, y, one = (stored[:, axis].astype(np.float32) for axis in range(3))
    x, y = x / one, y / one
    z = 1 - np.abs(x) - np.abs(y)
    below = np.minimum(z, 0)
    vectors = np.stack([x - np.copysign(below, x), y - np.copysign(below, y), z], axis=1)
    decoded = stored.copy()
    decoded[:, :3] = _round(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), decoded.dtype)
    return decoded


def _filter_quaternion(rows: NDArray[np.uint8]) -> NDArray[Any]:
    """Decodes unit quaternions from three components. The fourth value holds 1.0 and, in two bits, the missing one."""
    stored = rows.view("<i2")  # (n, 4)
    xyz = stored[:, :3] / (stored[:, 3:] | 3).astype(np.float32) / np.sqrt(np.float32(2))
    w = np.sqrt(np.maximum(0, 1 - np.square(xyz).sum(axis=1)))
    decoded = np.empty_like(stored)
    places = (stored[:, 3:] + np.arange(1, 5)) & 3
    np.put_along_axis(decoded, places, _round(np.column_stack([xyz, w]), decoded.dtype), axis=1)
    return decoded


def _filter_exponential(rows: NDArray[np.uint8]) -> NDArray[Any]:
    """Decodes floats from signed exponents of 8 bits and mantissas of 24 bits."""
    stored = rows.view("<i4")
    values: NDArray[np.float32] = np.ldexp((stored << 8 >> 8).astype(np.float32), stored >> 24)
    return values


def _filter_color(rows: NDArray[np.uint8]) -> NDArray[Any]:
    """Decodes RGBA from Y, Co, Cg of K bits. Alpha has K - 1 bits and one bit above them, which gives K."""
    size = rows.shape[1] // 4
    y, co, cg, alpha = rows.view(f"<i{size}").astype(np.int32).T
    y, alpha = (values & (1 << 8 * size) - 1 for values in (y, alpha))
    most = (1 << np.frexp(alpha.astype(np.float64))[1]) - 1
    alpha &= most >> 1
    rgba = np.stack([y + co - cg, y + cg, y - co - cg, alpha << 1 | alpha & 1], axis=1)
    return _round(rgba / most[:, None], np.dtype(f"<u{size}"))


def _round(values: NDArray[np.floating], dtype: np.dtype[Any]) -> NDArray[Any]:
    limits = np.iinfo(dtype)
    rounded: NDArray[Any] = np.clip(np.nan_to_num(np.rint(values * limits.max)), limits.min, limits.max).astype(dtype)
    return rounded


FILTERS: dict[str, Callable[[NDArray[np.uint8]], NDArray[Any]]] = {
    "OCTAHEDRAL": _filter_octahedral,
    "QUATERNION": _filter_quaternion,
    "EXPONENTIAL": _filter_exponential,
    "COLOR": _filter_color,
}
