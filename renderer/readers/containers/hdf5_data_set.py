"""Data sets of an untrusted HDF5 file: only those in the file itself, unpacked to no more than their size."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import h5py
import numpy as np

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

_FILTERS = (h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_LZF, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32)
_CHECKSUM_BYTES = 4


def find_shape(file: h5py.File, key: str) -> tuple[int, ...]:
    """Returns the shape of a data set in the file itself; empty for anything else."""
    if not isinstance(file.get(key, getlink=True), h5py.HardLink):
        return ()
    found = file[key]
    return tuple(found.shape or ()) if isinstance(found, h5py.Dataset) else ()


def holds_references(found: h5py.Dataset) -> bool:
    """Returns whether a data set holds references to objects of its file."""
    return bool(found.id.get_type() == h5py.h5t.STD_REF_OBJ)


def list_referenced(found: h5py.Dataset, data: bytes) -> Iterator[h5py.Dataset | None]:
    """Yields the data sets to which references to objects of the file `data` point.

    Yields None for a data set whose samples are in another file, for one that was listed before, and for any other
    object. Yields nothing if the references are packed or cut off.
    """
    start, size = found.id.get_offset(), 8 * math.prod(found.shape)
    if _lies_elsewhere(found.id) or start is None or found.id.get_storage_size() != size or start + size > len(data):
        return
    addresses = np.frombuffer(data, "<u8", size // 8, start).tolist()
    listed: set[int] = set()
    for address, reference in zip(addresses, found[()].flat, strict=True):
        handle = h5py.h5r.dereference(reference, found.file.id) if reference and address not in listed else None
        listed.add(address)
        is_here = isinstance(handle, h5py.h5d.DatasetID) and not _lies_elsewhere(handle)
        yield h5py.Dataset(handle) if is_here else None


def _lies_elsewhere(found: h5py.h5d.DatasetID) -> bool:
    plan = found.get_create_plist()
    return bool(plan.get_external_count() or plan.get_layout() == h5py.h5d.VIRTUAL)


@dataclass(frozen=True)
class DataSet:
    """A data set whose samples are in the file and are packed in a known way."""

    handle: h5py.Dataset
    data: bytes
    """The content of the file."""
    name: str
    """The file's name in messages."""

    @classmethod
    def open(cls, file: h5py.File, key: str, data: bytes, name: str) -> DataSet:
        """Returns the data set `key` of the file `name`. Raises `UnsupportedType` if it is stored or packed in another
        way, and `TooLarge` if its chunks are too large.
        """
        return cls.check(file[key], key, data, name)

    @classmethod
    def check(cls, handle: h5py.Dataset, key: str, data: bytes, name: str) -> DataSet:
        """Returns the data set that is open as `handle`, and raises like `open`; `key` is for messages."""
        found = cls(handle, data, name)
        filters = found.list_filters()
        if _lies_elsewhere(handle.id):
            raise UnsupportedType(f"{name}: {clean_text(key)} lies in another file; save it as one file")
        if any(number not in _FILTERS for number in filters) or len(set(filters)) < len(filters):
            raise UnsupportedType(
                f"{name}: {clean_text(key)} is packed by filter {filters}; save it with gzip or unpacked"
            )
        if handle.chunks is not None and np.prod(handle.chunks, dtype=float) > 2 * np.prod(handle.shape, dtype=float):
            raise TooLarge(f"{name}: {clean_text(key)} has chunks larger than itself; save it unpacked")
        return found

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the samples."""
        return tuple(self.handle.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the samples."""
        return cast("np.dtype[Any]", self.handle.dtype)

    def list_filters(self) -> list[int]:
        """Returns HDF5's numbers of the filters that were applied, in order."""
        plan = self.handle.id.get_create_plist()
        return [plan.get_filter(index)[0] for index in range(plan.get_nfilters())]

    def read(self) -> NDArray[Any]:
        """Reads all samples, whose size must have been checked. Samples in one piece are returned without a copy,
        read-only.

        Chunks are unpacked here because HDF5 allocates whatever comes out of them, and some invalid ones crash the
        process. Checksums are not compared.

        Raises `Unreadable` if the samples are cut off, or if a chunk doesn't unpack to its samples.
        """
        handle, filters, start = self.handle, self.list_filters(), self.handle.id.get_offset()
        count = math.prod(self.shape)
        if start is not None:
            if start + count * self.dtype.itemsize > len(self.data):
                raise Unreadable(f"{self.name}: the samples are cut off; give the whole file")
            return np.frombuffer(self.data, self.dtype, count, start).reshape(self.shape)
        handle.id.get_create_plist().fill_value_defined()  # raises for a fill value that would crash the process
        if handle.chunks is None:  # stored within the header, or no samples stored
            return cast("NDArray[Any]", handle[()])
        samples = np.full(self.shape, handle.fillvalue, self.dtype)
        chunks: list[Any] = []
        handle.id.chunk_iter(chunks.append)
        for chunk in chunks:
            if chunk.size > len(self.data):
                raise Unreadable(f"{self.name}: a chunk is larger than the file; give the whole file")
            mask, packed = handle.id.read_direct_chunk(chunk.chunk_offset)
            applied = [number for index, number in enumerate(filters) if not mask >> index & 1]
            whole = _unpack_chunk(packed, applied, math.prod(handle.chunks), self.dtype, self.name)
            target = samples[tuple(map(slice, chunk.chunk_offset, np.add(chunk.chunk_offset, handle.chunks)))]
            target[:] = whole.reshape(handle.chunks)[tuple(map(slice, target.shape))]
        return samples


def _unpack_chunk(packed: bytes, filters: Sequence[int], count: int, dtype: np.dtype[Any], name: str) -> NDArray[Any]:
    """Unpacks the `count` samples of a chunk to which `filters` were applied in order."""
    size = count * dtype.itemsize
    for number in reversed(filters):
        if number == h5py.h5z.FILTER_FLETCHER32:
            packed = packed[:-_CHECKSUM_BYTES]
        elif number == h5py.h5z.FILTER_LZF:
            import imagecodecs  # only if a file is packed with it

            packed = bytes(imagecodecs.lzf_decode(packed, out=size + _CHECKSUM_BYTES + 1))
        elif number == h5py.h5z.FILTER_DEFLATE:
            packed = zlib.decompressobj().decompress(packed, size + _CHECKSUM_BYTES + 1)
        elif len(packed) == size:  # shuffled: first bytes of all samples first
            packed = np.frombuffer(packed, np.uint8).reshape(dtype.itemsize, count).T.tobytes()
    if len(packed) != size:
        raise Unreadable(f"{name}: a chunk unpacks to {len(packed):,} bytes, not its {size:,}; save it again")
    return np.frombuffer(packed, dtype)
