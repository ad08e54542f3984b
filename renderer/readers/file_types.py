"""Which kind of file something is: by its content, and only where its name agrees."""

from __future__ import annotations

import enum
import re
from pathlib import PurePosixPath

from ciir.errors import Unreadable, UnsupportedType
from ciir.renderer.readers.names import shown


class Kind(enum.Enum):
    """A kind of file that is read."""

    GLB = "glb"
    GLTF = "gltf"
    OBJ = "obj"
    PLY = "ply"
    STL = "stl"
    OFF = "off"
    PNG = "png"
    JPEG = "jpg"
    TIFF = "tif"
    ZIP = "zip"


MESHES = frozenset({Kind.GLB, Kind.GLTF, Kind.OBJ, Kind.PLY, Kind.STL, Kind.OFF})
"""Kinds that `renderer.readers.meshes.read` takes."""
PICTURES = frozenset({Kind.PNG, Kind.JPEG, Kind.TIFF})
"""Kinds that `renderer.readers.pictures.decode` takes."""
SUFFIXES = {f".{kind.value}": kind for kind in Kind} | {".jpeg": Kind.JPEG, ".tiff": Kind.TIFF}
"""The file name suffixes that are known, in lower case, and what each claims."""

_MAGIC = (
    (b"glTF", Kind.GLB),
    (b"\x89PNG\r\n\x1a\n", Kind.PNG),
    (b"\xff\xd8\xff", Kind.JPEG),
    (b"II*\0", Kind.TIFF),
    (b"MM\0*", Kind.TIFF),
    (b"II+\0", Kind.TIFF),  # BigTIFF
    (b"MM\0+", Kind.TIFF),
    (b"PK\x03\x04", Kind.ZIP),
    (b"PK\x05\x06", Kind.ZIP),  # a zip without files
    (b"ply\n", Kind.PLY),
    (b"ply\r", Kind.PLY),
)
_READ = ", ".join(SUFFIXES)
_BOM = b"\xef\xbb\xbf"
_OFF = re.compile(rb"C?OFF\b")
_FIRST_WORD = re.compile(rb"^[ \t\r\f\v]*(?=[^\s#])", re.MULTILINE)
"""Ends where the first line that is no comment begins."""
_OBJ = re.compile(rb"^[ \t]*v[ \t]+[-+.\d]", re.MULTILINE)
_STL_HEADER = 84  # 80 bytes of free text, then the number of triangles as uint32
_STL_TRIANGLE = 50


def claimed(name: str) -> Kind | None:
    """What the suffix of `name` claims; None where it has none.

    Raises `UnsupportedType` where the suffix is not one of `SUFFIXES`.
    """
    suffix = PurePosixPath(name.replace("\\", "/")).suffix.lower()
    if suffix and suffix not in SUFFIXES:
        raise UnsupportedType(f"{shown(name)}: files of type {shown(suffix)} are not read; give one of {_READ}")
    return SUFFIXES.get(suffix)


def identify(name: str, data: bytes) -> Kind:
    """The kind of `data`, on which its content and the suffix of `name` agree; without a suffix content alone.

    Raises `Unreadable` for no bytes at all, `UnsupportedType` where name and content disagree or are unknown.
    """
    name_says = claimed(name)
    if not data:
        raise Unreadable(f"{shown(name)}: the file is empty (0 bytes); give it again")
    content_is = _content(data, name_says)
    if content_is is None:
        what = "text" if _is_text(data) else "binary data"
        raise UnsupportedType(f"{shown(name)}: {what} of no known kind; give one of {_READ}")
    if name_says not in {None, content_is}:
        raise UnsupportedType(
            f"{shown(name)}: the name says {name_says.name if name_says else ''} but the content is {content_is.name}; "
            f"rename it, or give one of {_READ}"
        )
    return content_is


def by_magic(data: bytes) -> Kind | None:
    """The kind that the first bytes of `data` are the mark of; None for kinds without a mark, and unknown ones."""
    return next((kind for magic, kind in _MAGIC if data.startswith(magic)), None)


def _content(data: bytes, name_says: Kind | None) -> Kind | None:
    kind = by_magic(data)
    if kind is not None:
        return kind
    # Before "solid": many writers begin the free text of a binary STL with that word.
    if len(data) >= _STL_HEADER and len(data) == _STL_HEADER + _STL_TRIANGLE * int.from_bytes(data[80:84], "little"):
        return Kind.STL
    if _is_text(data):
        return _text(data.removeprefix(_BOM).lstrip(), name_says)
    # A binary STL has no magic, and one that is cut short fails even the sum above: let its reader say so.
    return name_says if name_says is Kind.STL else None


def _text(text: bytes, name_says: Kind | None) -> Kind | None:
    if text.startswith(b"{") and (name_says is Kind.GLTF or b'"asset"' in text):
        return Kind.GLTF
    if text[:5].lower() == b"solid" and (name_says is Kind.STL or b"facet" in text):
        return Kind.STL
    first = _FIRST_WORD.search(text)
    if first is not None and _OFF.match(text, first.end()):
        return Kind.OFF
    return Kind.OBJ if _OBJ.search(text) else None


def _is_text(data: bytes) -> bool:
    return b"\0" not in data[:65536]
