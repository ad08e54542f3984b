"""The registry of input formats: their suffixes, how content is recognised, and the functions that read it.

To add a format, write one module with its reader and add one entry to `FORMATS`. Readers are imported when first used.
"""

from __future__ import annotations

import re
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Protocol

from ciir.errors import InputError, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ciir.renderer.light_field import LightField
    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.surface import Surface


class MeshReader(Protocol):
    """Reads a mesh file's bytes. Any error except an `InputError` becomes `Unreadable`."""

    def __call__(self, data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
        """Returns the file's surfaces. `name` is used in messages; textures and other files come from `resolver`."""


class PictureDecoder(Protocol):
    """Decodes a picture file's bytes. Any error except an `InputError` becomes `Unreadable`."""

    def __call__(self, data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
        """Returns the pixels as stored, and the orientation, 1 to 8.

        `check_size(height, width)` must be called before anything of that size is allocated.
        """


class ContainerReader(Protocol):
    """Reads a file that holds a whole light field. Any error except an `InputError` becomes `Unreadable`."""

    def __call__(self, data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
        """Returns the light field with its depth sense. `name` is used in messages.

        Sizes must be checked against `limits` before anything of that size is allocated.
        """


@dataclass(frozen=True, kw_only=True)
class Format:
    """A file format that is read."""

    name: str
    """The format's name in messages."""
    suffixes: tuple[str, ...]
    """The suffixes in lower case; the first one is the usual one."""
    signatures: tuple[bytes, ...] = ()
    """The byte strings that files start with, one of them; empty for formats without a signature."""
    text: re.Pattern[bytes] | None = None
    """The pattern of a text format without a signature. Every file matches it after leading white space is removed."""
    reader: str = ""
    """`module:function` of its `MeshReader`, `PictureDecoder` or `ContainerReader`, the module relative to `folder`."""
    remedy: str = "save it again"
    """The remedy in the message about files whose content is something else."""
    folder = "readers"

    @property
    def extension(self) -> str:
        """The usual suffix without its dot."""
        return self.suffixes[0].removeprefix(".")

    def load_reader(self) -> Any:
        """Imports the reader."""
        module, _, function = self.reader.partition(":")
        return getattr(import_module(f"ciir.renderer.{self.folder}.{module}"), function)


@dataclass(frozen=True, kw_only=True)
class MeshFormat(Format):
    """A mesh format."""

    is_posed: bool = False
    """Whether its reader takes a `MeshPose`, as `pose`, and returns the surfaces and a `Lens` or None."""
    is_one_file: bool = False
    """Whether files usually hold their textures or have none, so that pictures next to them are something else."""

    folder = "readers.meshes"


class PictureFormat(Format):
    """A picture format."""


class ContainerFormat(Format):
    """A format of whole light fields."""

    folder = "readers.containers"


HDF5 = b"\x89HDF\r\n\x1a\n"
ZIP = Format(name="ZIP", suffixes=(".zip",), signatures=(b"PK\x03\x04", b"PK\x05\x06"))  # the second: an empty zip
STL = MeshFormat(
    name="STL",
    suffixes=(".stl",),
    text=re.compile(rb"\A(?i:solid).*?facet", re.DOTALL),
    reader="trimesh_formats:read_stl",
    is_one_file=True,
)
LYTRO = PictureFormat(
    name="Lytro", suffixes=(".lfr", ".lfp"), signatures=(b"\x89LFP\r\n\x1a\n",), reader="lytro.picture:decode"
)
LYTRO_RAW = PictureFormat(name="Lytro RAW", suffixes=(".raw",), reader="lytro.picture:decode_raw")
LYTRO_RAW_SIZES = (51_854_880, 16_137_600)
"""The sizes in bytes of `.raw` files of an Illum and an F01. These files have no signature."""
FORMATS: tuple[Format, ...] = (
    MeshFormat(
        name="GLB",
        suffixes=(".glb", ".vrm"),
        signatures=(b"glTF",),
        reader="gltf.scene:read",
        is_posed=True,
        is_one_file=True,
    ),
    MeshFormat(
        name="GLTF",
        suffixes=(".gltf",),
        text=re.compile(rb'\A\{.*?"asset"', re.DOTALL),
        reader="gltf.scene:read",
        is_posed=True,
    ),
    MeshFormat(name="PLY", suffixes=(".ply",), signatures=(b"ply\n", b"ply\r"), reader="ply:read", is_one_file=True),
    STL,
    # The first word of the first line that is not a comment.
    MeshFormat(
        name="OFF",
        suffixes=(".off",),
        text=re.compile(rb"\A(?:\s*+(?:#[^\n]*+\n)?+)*+C?OFF\b"),
        reader="trimesh_formats:read_off",
        is_one_file=True,
    ),
    MeshFormat(
        name="OBJ", suffixes=(".obj",), text=re.compile(rb"^[ \t]*[vV][ \t]+[-+.\d]", re.MULTILINE), reader="obj:read"
    ),
    MeshFormat(name="DAE", suffixes=(".dae",), text=re.compile(rb"\A<[^\0]{0,4096}?<?COLLADA[\s>]"), reader="dae:read"),
    PictureFormat(name="PNG", suffixes=(".png",), signatures=(b"\x89PNG\r\n\x1a\n",), reader="png:decode"),
    PictureFormat(name="JPEG", suffixes=(".jpg", ".jpeg"), signatures=(b"\xff\xd8\xff",), reader="jpeg:decode"),
    PictureFormat(
        name="TIFF",
        suffixes=(".tif", ".tiff"),
        signatures=(b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"),  # the last two are BigTIFF
        reader="tiff:decode",
    ),
    PictureFormat(name="WebP", suffixes=(".webp",), signatures=(b"RIFF",), reader="webp:decode"),
    PictureFormat(
        name="PPM",
        suffixes=(".ppm", ".pgm", ".pnm"),
        signatures=tuple(f"P{kind}{after}".encode() for kind in "56" for after in " \t\n\v\f\r#"),
        reader="uncompressed.netpbm:decode",
        remedy="save it as binary PPM or PGM (P6 or P5)",
    ),
    PictureFormat(name="BMP", suffixes=(".bmp",), signatures=(b"BM",), reader="uncompressed.bmp:decode"),
    LYTRO,
    LYTRO_RAW,
    PictureFormat(name="KTX2", suffixes=(".ktx2",), signatures=(b"\xabKTX 20\xbb\r\n\x1a\n",), reader="ktx2:decode"),
    ZIP,
    ContainerFormat(name="NPY", suffixes=(".npy",), signatures=(b"\x93NUMPY",), reader="arrays:read_npy"),
    ContainerFormat(name="NPZ", suffixes=(".npz",), signatures=ZIP.signatures, reader="arrays:read_npz"),
    ContainerFormat(
        name="MAT",
        suffixes=(".mat",),
        signatures=(b"MATLAB 5.0 MAT", b"MATLAB 7.3 MAT", HDF5),
        reader="mat:read",
        remedy="save it with -v7 or -v7.3 (version 4 holds no light fields)",
    ),
    ContainerFormat(name="HDF5", suffixes=(".h5", ".hdf5"), signatures=(HDF5,), reader="hdf5:read"),
    ContainerFormat(
        name="MP4",
        suffixes=(".mp4", ".m4v", ".mov"),
        signatures=tuple(bytes((0, 0, 0, size)) + b"ftyp" for size in range(12, 64, 4)),  # a box after its size
        reader="video:read",
    ),
    ContainerFormat(name="MKV", suffixes=(".mkv", ".webm"), signatures=(b"\x1aE\xdf\xa3",), reader="video:read"),
    ContainerFormat(name="GIF", suffixes=(".gif",), signatures=(b"GIF87a", b"GIF89a"), reader="video:read"),
    MeshFormat(  # a zip by content
        name="3MF", suffixes=(".3mf",), signatures=ZIP.signatures, reader="threemf:read", is_one_file=True
    ),
)
"""Every format that is read. If content fits several, the suffix decides, or else the order of this list."""

VIDEOS = ("MP4", "MKV", "GIF")
"""The names of the containers with frames."""
TIFF_STACK = ContainerFormat(name="TIFF stack", suffixes=(".tif", ".tiff"), reader="tiff_stack:read")
ESLF = ContainerFormat(name="ESLF", suffixes=(".png",), reader="eslf:read")
"""Containers that are also pictures. Their content or name says so; `readers.inputs` checks these."""
ARRAYS = ("NPY", "NPZ", "MAT", "HDF5")
"""The names of the containers of arrays."""
ARRAY_PICTURE = PictureFormat(name="array", suffixes=(".npy", ".npz", ".mat", ".h5", ".hdf5"))
"""A file of `ARRAYS` with a picture in it; `containers.array_pictures` reads it."""

SUFFIXES: dict[str, Format] = {suffix: entry for entry in FORMATS for suffix in entry.suffixes}
"""The format of each suffix."""
READ = ", ".join(SUFFIXES)
"""All suffixes, for messages."""

MESHES = ", ".join(suffix for suffix, entry in SUFFIXES.items() if isinstance(entry, MeshFormat))
"""The suffixes of meshes, for messages."""
OTHER_MESHES = frozenset(
    (".3ds", ".abc", ".blend", ".c4d", ".fbx", ".ma", ".max", ".mb", ".skp", ".step", ".stp", ".usd", ".usda", ".usdc")
) | {".usdz", ".wrl", ".x3d"}
"""Suffixes of meshes that are not read."""
_PLACEHOLDERS = (
    (
        re.compile(rb"(\xef\xbb\xbf)?\s*(<!--.{0,4096}?-->\s*)?<(!doctype\s+html|html\b)", re.IGNORECASE | re.DOTALL),
        "this is a web page; download the file itself",
    ),
    (
        re.compile(rb"version https://git-lfs\.github\.com/spec/"),
        "this is a Git LFS pointer; download the file itself, as git lfs pull does",
    ),
)
"""Patterns of data that may be stored in place of a file, with the messages about them."""

_USER_BLOCKS = tuple(512 * 2**n for n in range(12))
"""The sizes of user blocks that may precede HDF5 (HDF5 File Format Specification 3.0, II.A)."""
_BOM = b"\xef\xbb\xbf"
_STL_HEADER = 84  # 80 bytes of free text, then the number of triangles as uint32
_STL_TRIANGLE = 50


def find_by_suffix(name: str) -> Format | None:
    """Returns the format of the suffix of `name`, or None for a name without a suffix.

    Raises `UnsupportedType` for a suffix that is not one of `SUFFIXES`.
    """
    suffix = PurePosixPath(name.replace("\\", "/")).suffix.lower()
    if suffix in OTHER_MESHES:
        raise UnsupportedType(
            f"{clean_text(name)}: meshes of type {suffix} are not read; export it as GLB (these are read: {MESHES})"
        )
    if suffix and suffix not in SUFFIXES:
        raise UnsupportedType(
            f"{clean_text(name)}: files of type {clean_text(suffix)} are not read; give one of {READ}"
        )
    return SUFFIXES.get(suffix)


def is_picture(name: str) -> bool:
    """Checks whether `name` has the suffix of a picture format."""
    return isinstance(SUFFIXES.get(PurePosixPath(name).suffix.lower()), PictureFormat)


def is_mesh(name: str) -> bool:
    """Checks whether `name` has the suffix of a mesh format."""
    return isinstance(SUFFIXES.get(PurePosixPath(name).suffix.lower()), MeshFormat)


def has_texture_files(name: str) -> bool:
    """Checks whether `name` has the suffix of a mesh format whose textures are usually files of their own."""
    found = SUFFIXES.get(PurePosixPath(name).suffix.lower())
    return isinstance(found, MeshFormat) and not found.is_one_file


def may_be_texture(name: str) -> bool:
    """Checks whether `name` has the suffix of a picture format that can hold a texture, unlike those of cameras."""
    return is_picture(name) and SUFFIXES[PurePosixPath(name).suffix.lower()] not in (LYTRO, LYTRO_RAW)


def is_container(name: str) -> bool:
    """Checks whether `name` has the suffix of a format of whole light fields."""
    return isinstance(SUFFIXES.get(PurePosixPath(name).suffix.lower()), ContainerFormat)


def find_by_signature(data: bytes) -> list[Format]:
    """Returns the formats with a signature that `data` starts with."""
    return [entry for entry in FORMATS if data.startswith(entry.signatures)]


def identify(name: str, data: bytes) -> Format:
    """Returns the format of `data` if its content and the suffix of `name` agree. Without a suffix the content decides.

    Raises `Unreadable` for empty data, and `UnsupportedType` if name and content disagree or the format is unknown.
    """
    by_name = find_by_suffix(name)
    if not data:
        raise Unreadable(f"{clean_text(name)}: the file is empty (0 bytes); give it again")
    by_content = _recognise(data, by_name)
    if by_content is None:
        for start, advice in _PLACEHOLDERS:
            if start.match(data):
                raise UnsupportedType(f"{clean_text(name)}: {advice}")
        what = "text" if _is_text(data) else "binary data"
        if by_name is not None:
            raise UnsupportedType(f"{clean_text(name)}: the content is {what}, not {by_name.name}; {by_name.remedy}")
        raise UnsupportedType(f"{clean_text(name)}: {what} of no known format; give one of {READ}")
    if by_name not in {None, by_content}:
        what = f"the suffix is that of {by_name.name if by_name else ''} but the content is {by_content.name}"
        raise UnsupportedType(f"{clean_text(name)}: {what}; rename it to end with {by_content.suffixes[0]}")
    return by_content


def _recognise(data: bytes, by_name: Format | None) -> Format | None:
    if by_name is STL and _has_stl_size(data):  # its header is any text, also one that starts with BM or P6
        return STL
    signed = find_by_signature(data) or find_by_signature(_find_hdf5(data))
    if signed:
        return by_name if by_name in signed else signed[0]
    if _is_text(data):
        text = data.removeprefix(_BOM).lstrip()
        return next((entry for entry in FORMATS if entry.text is not None and entry.text.search(text)), None)
    if by_name is LYTRO_RAW and len(data) in LYTRO_RAW_SIZES:
        return LYTRO_RAW
    # A binary STL has no signature, and one that is cut short not even the right size: its reader reports that.
    return STL if by_name is STL or _has_stl_size(data) else None


def _has_stl_size(data: bytes) -> bool:
    """Checks whether `data` is as long as a binary STL with the number of triangles that it states."""
    size = _STL_HEADER + _STL_TRIANGLE * int.from_bytes(data[80:_STL_HEADER], "little")
    return len(data) >= _STL_HEADER and len(data) == size


def _find_hdf5(data: bytes) -> bytes:
    """Returns the start of HDF5 after a user block of any content (512 bytes times a power of two); "" if none."""
    at = next((at for at in _USER_BLOCKS if data.startswith(HDF5, at)), None)
    return b"" if at is None else data[at : at + len(HDF5)]


def _is_text(data: bytes) -> bool:
    return b"\0" not in data[:65536]


@contextmanager
def reported(name: str, format_: Format) -> Iterator[None]:
    """Reports any error of a container format's library as damage, and lack of memory as such."""
    try:
        yield
    except InputError:
        raise
    except MemoryError as error:
        raise TooLarge(f"{name}: reading it takes more memory than there is; give fewer or smaller views") from error
    except Exception as error:
        raise Unreadable(
            f"{name}: damaged or cut off (while the views of the {format_.name} file were read); send the whole file"
        ) from error
