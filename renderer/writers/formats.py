"""The registry of formats that store views in one file.

Picture formats come from `renderer.writers.pictures.registry`. A format for several views is a module with its
`Writer`, and a line in `FORMATS`; one for whole light fields is a `WholeWriter` in `renderer/writers/containers`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from importlib import import_module
from typing import IO, TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.displays.pictures import USES, describes_print, find_kind
from ciir.renderer.displays.quilt import parse_name
from ciir.renderer.readers.names import is_eslf
from ciir.renderer.writers import pictures
from ciir.renderer.writers.archives import NpzWriter, ZipWriter
from ciir.renderer.writers.html import HtmlWriter
from ciir.renderer.writers.options import OF_FILE, WriterOptions
from ciir.renderer.writers.writer import Writer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import PurePath

    from ciir.renderer.displays.pictures import Kind
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Contents


class SingleWriter(Writer):
    """Writes one view into a binary file. A picture holds no report."""

    def __init__(self, file: IO[bytes], picture: pictures.PictureFormat, options: WriterOptions) -> None:
        self._file, self._picture, self._options = file, picture, options

    def begin(self, contents: Contents) -> None:
        """Refuses more than one view, and pixels that the format can't hold."""
        contents.refuse_times(self._picture.name)
        count = len(contents.views)
        if count != 1:
            folder = "a folder (a name without a suffix), " if self._options.name else ""
            raise InvalidOption(
                f"format: {self._picture.name} holds one view and {count} are asked for; give {folder}zip or npz, or "
                "one view"
            )
        self._picture.encode(contents.sample)

    def write(self, view: View, pixels: Pixels) -> str:
        """Writes the picture."""
        self._file.write(self._picture.encode(pixels))
        return f"view_{view[0]:02d}_{view[1]:02d}{self._picture.suffixes[0]}"

    def finish(self, report: dict[str, Any]) -> None:
        """Adds nothing."""


@dataclass(frozen=True)
class Format:
    """A format of one file."""

    name: str
    suffixes: tuple[str, ...]
    """Suffixes of file names, in lower case; the first is the usual one."""
    media_type: str
    open: Callable[[IO[bytes], WriterOptions], Writer]
    """Function that makes a writer to a binary file."""
    uses: tuple[str, ...] = ()
    """The names of the `WriterOptions` that it uses."""

    def make_writer(self, file: IO[bytes], options: WriterOptions) -> Writer:
        """Returns a writer to a binary file. Raises `InvalidOption` for an option that the format does not use."""
        check_options(options, self.uses, f"format {self.name}")
        return self.open(file, options)


def _picture(picture: pictures.PictureFormat) -> Format:
    """Makes a format for one view."""

    def open_writer(file: IO[bytes], options: WriterOptions) -> Writer:
        return SingleWriter(file, picture, options)

    return Format(picture.name, picture.suffixes, picture.media_type, open_writer)


def _container(
    name: str, suffixes: tuple[str, ...], media_type: str, writer: str, uses: tuple[str, ...] = ()
) -> Format:
    """Makes a format for whole light fields, whose `writer` is `module:class`, imported when it is first used."""
    module, _, class_ = writer.partition(":")

    def open_writer(file: IO[bytes], options: WriterOptions) -> Writer:
        found: Writer = getattr(import_module(f"ciir.renderer.writers.containers.{module}"), class_)(file, options)
        return found

    return Format(name, suffixes, media_type, open_writer, uses=uses)


def check_options(options: WriterOptions, uses: tuple[str, ...], what: str) -> None:
    """Raises `InvalidOption` for an option that differs from its default, unless it is in `uses`, those of `what`."""
    for field in fields(WriterOptions):
        if field.name not in {*OF_FILE, *uses} and getattr(options, field.name) != field.default:
            others = ", ".join(entry.name for entry in FORMATS.values() if field.name in entry.uses)
            raise InvalidOption(f"{field.name}: {what} has no use for it; leave it out, or give format {others}")


STILL = tuple(suffix for suffix in pictures.SUFFIXES if suffix != ".webp")
"""The suffixes of pictures without motion: for a whole light field, WebP is an animation."""
EXACT = tuple(suffix for suffix in pictures.SUFFIXES if suffix not in (".jpg", ".jpeg"))
"""The suffixes of pictures that keep every subpixel, which lenses tell apart."""
VIDEO = ("path", "frames", "fps")
"""The `WriterOptions` that a video format uses."""
BINARY = "application/octet-stream"
"""The media type of formats without one of their own."""

FORMATS = {
    entry.name: entry
    for entry in (
        *map(_picture, pictures.FORMATS),
        Format("zip", (".zip",), "application/zip", lambda file, _: ZipWriter(file)),
        Format("npz", (".npz",), "application/x-npz", lambda file, _: NpzWriter(file)),
        Format("html", (".html",), "text/html", lambda file, _: HtmlWriter(file)),
        _container("eia", STILL, "image/png", "pictures:EiaWriter"),
        _container("mosaic", STILL, "image/png", "pictures:MosaicWriter"),
        _container("eslf", (".png",), "image/png", "pictures:EslfWriter"),
        _container("stack", (".tif", ".tiff"), "image/tiff", "pictures:StackWriter"),
        _container("epi", STILL, "image/png", "pictures:EpiWriter", ("epi",)),
        _container("tiles", (".zip",), "application/zip", "tiles:TilesWriter"),
        _container("npy", (".npy",), BINARY, "arrays:NpyWriter"),
        _container("mat", (".mat",), BINARY, "matlab:MatWriter"),
        _container("mat73", (".mat",), BINARY, "matlab:Mat73Writer"),
        _container("hci", (".h5", ".hdf5"), BINARY, "matlab:HciWriter"),
        _container("mp4", (".mp4",), "video/mp4", "video:Mp4Writer", VIDEO),
        _container("webm", (".webm",), "video/webm", "video:WebmWriter", VIDEO),
        _container("gif", (".gif",), "image/gif", "video:GifWriter", VIDEO),
        _container("animated-webp", (".webp",), "image/webp", "video:WebpWriter", VIDEO),
        _container("quilt", pictures.SUFFIXES, "image/png", "displays:QuiltWriter", USES["quilt"]),
        _container("lenticular", EXACT, "image/png", "displays:LenticularWriter", USES["lenticular"]),
        _container("panel", EXACT, "image/png", "displays:PanelWriter", USES["panel"]),
    )
}
"""The formats by name. If several have the same suffix, the first one is its format."""


def _index_suffixes(formats: Iterable[Format]) -> dict[str, Format]:
    found: dict[str, Format] = {}
    for entry in formats:
        for suffix in entry.suffixes:
            found.setdefault(suffix, entry)
    return found


BY_SUFFIX = _index_suffixes(FORMATS.values())
"""The format of views for a file name's suffix: a picture is one view."""
BY_SUFFIX_OF_TIMES = BY_SUFFIX | {".webp": FORMATS["animated-webp"]}
"""The format of one view at several times for a file name's suffix."""
WHOLE = {name: entry for name, entry in FORMATS.items() if name not in {picture.name for picture in pictures.FORMATS}}
"""The formats that can hold a whole light field, by name."""
WHOLE_BY_SUFFIX = _index_suffixes(WHOLE.values())
"""The format of a whole light field for a file name's suffix: a picture is an elemental image array."""


def find_display(path: PurePath, options: WriterOptions) -> Kind | None:
    """Returns the kind of picture for a display that the options, or a quilt's name, ask for if no format is given."""
    if options.display or options.calibration or options.device or options.quilt or describes_print(options):
        return find_kind(options)
    is_named = path.suffix.lower() in FORMATS["quilt"].suffixes and parse_name(path.name) is not None
    return "quilt" if is_named else None


def find_implied(path: PurePath, options: WriterOptions) -> str | None:
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


class FileWriter(Writer):
    """Writes one file in the requested format; without one, PNG for one view and zip for several."""

    def __init__(self, file: IO[bytes], wanted: str | None, options: WriterOptions | None = None) -> None:
        if wanted is not None and wanted not in FORMATS:
            raise InvalidOption(f"format: {wanted[:40]!r} is not known; give {', '.join(FORMATS)}")
        self._file = file
        self._wanted = wanted
        self._options = options or WriterOptions()
        self._writer: Writer | None = None
        self.format = FORMATS["zip"]
        """The format; final from `begin` on."""

    def begin(self, contents: Contents) -> None:
        """Selects the format."""
        self.format = FORMATS[self._wanted or ("png" if len(contents.views) == 1 else "zip")]
        self._writer = self.format.make_writer(self._file, self._options)
        self._writer.begin(contents)

    def write(self, view: View, pixels: Pixels) -> str:
        """Writes the view."""
        assert self._writer is not None  # noqa: S101 - `begin` was called: the contract of Writer
        return self._writer.write(view, pixels)

    def finish(self, report: dict[str, Any]) -> None:
        """Completes the file."""
        assert self._writer is not None  # noqa: S101
        self._writer.finish(report)

    def discard(self) -> None:
        """Closes an archive that is not finished."""
        if self._writer is not None:
            self._writer.discard()
