"""What callers give as an input: a path, the content of a file, or an array."""

from __future__ import annotations

import io
import os
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from ciir.errors import InvalidOption, TooLarge
from ciir.renderer.readers.bundle import Bundle, read_file
from ciir.renderer.readers.names import clean_text
from ciir.renderer.readers.pictures import decode
from ciir.renderer.readers.registry import is_picture
from ciir.renderer.writers.atomic_write import read_path
from ciir.service.pipeline.limits import read_limits
from ciir.service.pipeline.source import Source, open_source

if TYPE_CHECKING:
    from os import PathLike

    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels


@runtime_checkable
class SupportsRead(Protocol):
    """A file object that is open for reading bytes."""

    def read(self, size: int, /) -> bytes:
        """Reads at most `size` bytes; returns none at the end."""
        ...


if TYPE_CHECKING:
    File = str | PathLike[str] | bytes | SupportsRead | NDArray[Any]
    """What is taken as an input."""


def open_given(given: File) -> Source:
    """Opens a path like `open_source`, or what `read_given` takes. Raises `InputError`."""
    read = read_given(given)
    return open_source(read) if isinstance(read, str) else Bundle.from_upload(*read, read_limits())


def read_picture(path: str | os.PathLike[str], name: str) -> Pixels:
    """Reads a picture file, as `(H, W)` if it is grey and otherwise as `(H, W, C)`.

    `name` is that of the argument, for messages. Raises `InputError`.
    """
    found, limits = read_path(path, name), read_limits()
    if not is_picture(found.name):
        raise InvalidOption(
            f"{name}: {clean_text(str(found))} is not a picture file; give one such as a PNG, or a light field as "
            "ciir.open returns it"
        )
    pixels = decode(read_file(found, limits), name=found.name, max_pixels=limits.pixels)
    return pixels[..., 0] if pixels.shape[2] == 1 else pixels


def read_given(path: File) -> str | tuple[str, bytes]:
    """Returns the text of a path, or the name and the content of a file that is given as bytes or as a file object, or
    that NumPy would write for an array.

    The file object is opened for reading bytes; its `name`, if it has one, gives the suffix. Raises `InvalidOption` for
    anything else, and `TooLarge`.
    """
    if isinstance(path, np.ndarray):
        if path.dtype.hasobject:
            raise InvalidOption("array.npy: an array of Python objects; give numbers, as in np.stack(list)")
        packed = io.BytesIO()
        np.save(packed, path, allow_pickle=False)
        return "array.npy", packed.getvalue()
    if isinstance(path, bytes | bytearray | memoryview):
        return "bytes", bytes(path)
    if isinstance(path, SupportsRead) and not isinstance(path, os.PathLike):  # a path that has read() is still a path
        given = getattr(path, "name", None)
        name = given if isinstance(given, str) else "file"
        return name, _read_all(path, name, read_limits().bytes)
    try:
        text = os.fspath(path)
    except TypeError as error:
        raise InvalidOption(
            f"a path, a file, bytes or a NumPy array is needed, not {type(path).__name__}; give a file's name, or "
            "np.asarray(...) of numbers"
        ) from error
    return os.fsdecode(text)


def _read_all(file: SupportsRead, name: str, most: int) -> bytes:
    """Reads the rest of a file.

    Raises `InvalidOption` if it doesn't return bytes, and `TooLarge` for more than `most`.
    """
    data = bytearray()
    while len(data) <= most:
        part = file.read(most + 1 - len(data))
        if not isinstance(part, bytes):
            raise InvalidOption(f"file: its read() gives {type(part).__name__}, not bytes; open it with mode 'rb'")
        if not part:
            return bytes(data)
        data += part
    raise TooLarge(f"{clean_text(name)}: over {most:,} bytes, the most that are read; give a smaller file", "bytes")
