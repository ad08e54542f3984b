"""The registry of formats that store views in one file.

A format is its line in `FORMATS`, and a `Writer` in the module that the line names. Picture formats have theirs in
`renderer.writers.pictures.registry`, and disparity maps in `renderer.writers.depth.maps`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.displays.pictures import USES, describes_print, find_kind
from ciir.renderer.displays.quilt import parse_name
from ciir.renderer.readers.names import is_eslf
from ciir.renderer.writers import pictures
from ciir.renderer.writers.file_types import BINARY, FileType, index_suffixes
from ciir.renderer.writers.options import FormatOptions

if TYPE_CHECKING:
    from pathlib import PurePath

    from ciir.renderer.displays.pictures import Kind


@dataclass(frozen=True)
class Format(FileType):
    """A format of one file."""

    writer: str
    """`module:class` of its `Writer`, which gets the file, the `WriterOptions` and the format's name. The module is
    relative to `renderer.writers`, and is imported when it is first used."""
    uses: tuple[str, ...] = ()
    """The names of the `FormatOptions` that it uses."""


_VIDEO = ("path", "frames", "fps")
"""The `FormatOptions` that a video format uses."""
_VIDEOS = (
    Format("mp4", (".mp4",), "video/mp4", "containers.video:Mp4Writer", _VIDEO),
    Format("webm", (".webm",), "video/webm", "containers.video:WebmWriter", _VIDEO),
    Format("gif", (".gif",), "image/gif", "containers.video:GifWriter", _VIDEO),
    Format("animated-webp", (".webp",), "image/webp", "containers.video:WebpWriter", _VIDEO),
)
VIDEOS = tuple(entry.name for entry in _VIDEOS)
"""The names of the formats that hold frames."""
FORMATS_OF_TIMES = (*VIDEOS, "zip")
"""The names of the formats that hold one view at several times."""
_STILL = tuple(suffix for suffix in pictures.SUFFIXES if suffix not in index_suffixes(_VIDEOS))
"""The suffixes of pictures without motion: for a whole light field, WebP is an animation."""
_EXACT = tuple(index_suffixes(entry for entry in pictures.FORMATS.values() if entry.is_lossless))
"""The suffixes of pictures that keep every subpixel, which lenses tell apart."""

FORMATS = {
    entry.name: entry
    for entry in (
        *(
            Format(entry.name, entry.suffixes, entry.media_type, "pictures.single:SingleWriter")
            for entry in pictures.FORMATS.values()
        ),
        Format("zip", (".zip",), "application/zip", "archives:ZipWriter"),
        Format("npz", (".npz",), "application/x-npz", "archives:NpzWriter"),
        Format("html", (".html",), "text/html", "html:HtmlWriter"),
        Format("eia", _STILL, "image/png", "containers.pictures:EiaWriter"),
        Format("mosaic", _STILL, "image/png", "containers.pictures:MosaicWriter"),
        Format("eslf", (".png",), "image/png", "containers.pictures:EslfWriter"),
        Format("stack", (".tif", ".tiff"), "image/tiff", "containers.pictures:StackWriter"),
        Format("epi", _STILL, "image/png", "containers.pictures:EpiWriter", ("epi",)),
        Format("tiles", (".zip",), "application/zip", "containers.tiles:TilesWriter"),
        Format("npy", (".npy",), BINARY, "containers.arrays:NpyWriter"),
        Format("mat", (".mat",), BINARY, "containers.matlab:MatWriter"),
        Format("mat73", (".mat",), BINARY, "containers.matlab:Mat73Writer"),
        Format("hci", (".h5", ".hdf5"), BINARY, "containers.matlab:HciWriter"),
        *_VIDEOS,
        Format("quilt", pictures.SUFFIXES, "image/png", "containers.displays:DisplayWriter", USES["quilt"]),
        Format("lenticular", _EXACT, "image/png", "containers.displays:DisplayWriter", USES["lenticular"]),
        Format("panel", _EXACT, "image/png", "containers.displays:DisplayWriter", USES["panel"]),
    )
}
"""The formats by name. If several have the same suffix, the first one is its format."""
BY_SUFFIX = index_suffixes(FORMATS.values())
"""The format of views for a file name's suffix: a picture is one view."""
BY_SUFFIX_OF_TIMES = BY_SUFFIX | index_suffixes(_VIDEOS)
"""The format of one view at several times for a file name's suffix."""
WHOLE = {name: entry for name, entry in FORMATS.items() if name not in pictures.FORMATS}
"""The formats that can hold a whole light field, by name."""
WHOLE_BY_SUFFIX = index_suffixes(WHOLE.values())
"""The format of a whole light field for a file name's suffix: a picture is an elemental image array."""


def find_display(path: PurePath, options: FormatOptions) -> Kind | None:
    """Returns the kind of picture for a display that the options, or a quilt's name, ask for if no format is given."""
    if options.display or options.calibration or options.device or options.quilt or describes_print(options):
        return find_kind(options)
    is_named = path.suffix.lower() in FORMATS["quilt"].suffixes and parse_name(path.name) is not None
    return "quilt" if is_named else None


def find_implied(path: PurePath, options: FormatOptions) -> str | None:
    """Returns the format if none is given: epi if its line is given, eslf if readers would take the file's name for
    one.
    """
    if options.epi:
        return "epi"
    return "eslf" if path.suffix.lower() == ".png" and is_eslf(path.name) else None


FOLDER = "folder"
"""The name of the format for a folder of views, which is not a file."""


def find_whole_format(name: str, path: PurePath) -> Format | None:
    """Returns the format `name`; None for a folder of views. Raises `InvalidOption` if it can't hold a light field, or
    `path` has another suffix.
    """
    suffix = path.suffix.lower()
    if name == FOLDER:
        if suffix in WHOLE_BY_SUFFIX:
            raise InvalidOption(f"{path}: a folder of views has no suffix; leave {path.suffix} out, or the format")
        return None
    found = WHOLE.get(name)
    if found is None:
        what = "is one picture, without the other views" if name in FORMATS else "is not known"
        raise InvalidOption(f"format: {name[:40]!r} {what}; give {', '.join([FOLDER, *WHOLE])}")
    if suffix not in found.suffixes:
        raise InvalidOption(f"{path}: {name} is written as {' or '.join(found.suffixes)}; end the name with that")
    return found


def check_options(options: FormatOptions, uses: tuple[str, ...], what: str) -> None:
    """Raises `InvalidOption` for an option that differs from its default, unless it is in `uses`, those of `what`. 0
    counts as not given.
    """
    for field in fields(FormatOptions):
        if field.name not in uses and (getattr(options, field.name) or field.default) != field.default:
            others = ", ".join(entry.name for entry in FORMATS.values() if field.name in entry.uses)
            raise InvalidOption(f"{field.name}: {what} has no use for it; leave it out, or give format {others}")
