"""Where finished views go: a folder, a zip, an npz or one PNG."""

from __future__ import annotations

import io
import json
import re
import zipfile
from typing import IO, TYPE_CHECKING, Any, Literal, Protocol, get_args

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.writers.atomic_write import Staged
from ciir.service.pipeline.report import Report, to_json

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import TracebackType

    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels

Format = Literal["png", "zip", "npz"]
FORMATS: tuple[str, ...] = get_args(Format)
REPORT = "report.json"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # zip's earliest date: the same views make the same bytes


class Sink(Protocol):
    """Takes the views of one reconstruction: `begin`, `add` for each view, `finish`."""

    def begin(self, count: int) -> None:
        """Told how many views will follow, before any is made; raises `InvalidOption` where they don't fit."""

    def add(self, view: tuple[int, int], pixels: Pixels) -> str:
        """Encodes and keeps view (v, u), `(H, W, C)`; returns its file name."""
        ...

    def finish(self, report: Report) -> None:
        """Adds the report where there is room for one, and completes the output."""


def file_name(view: tuple[int, int]) -> str:
    """`view_VV_UU.png`."""
    return f"view_{view[0]:02d}_{view[1]:02d}.png"


def _png(pixels: Pixels) -> bytes:
    from ciir.renderer.readers.pictures import encode_png

    return encode_png(pixels)


class FolderSink:
    """A folder of PNGs with `report.json`. As a context manager it leaves nothing behind where the work fails.

    The views that an earlier report there lists are removed, as they would pass for this run's; but not `given`, the
    file or the folder that is the input.
    """

    def __init__(self, path: Path, given: Path | None = None) -> None:
        if path.exists() and not path.is_dir():
            raise InvalidOption(f"{path}: a file is there; name a folder for the output, or remove it")
        self._path = path
        self._given = given.resolve() if given is not None else None
        self._names: set[str] = set()
        self._staged: Staged | None = None

    def begin(self, count: int) -> None:
        """Makes the folder that is written to; `count` is of no matter."""
        del count
        self._staged = Staged(self._path)

    def add(self, view: tuple[int, int], pixels: Pixels) -> str:
        """Writes a PNG."""
        assert self._staged is not None  # noqa: S101 - begin was called: Sink's contract
        name = file_name(view)
        self._staged.write(name, _png(pixels))
        self._names.add(name)
        return name

    def finish(self, report: Report) -> None:
        """Writes the report, with a note of the earlier views that are removed, and moves everything into place."""
        assert self._staged is not None  # noqa: S101
        for name in (*self._names, REPORT):
            if self._given is not None and (self._path / name).resolve() == self._given:
                raise InvalidOption(f"{self._path / name}: the input is there; give another folder for the output")
        stale = _earlier(self._path) - self._names
        if self._given is not None:
            stale = {name for name in stale if not (self._path / name).resolve().is_relative_to(self._given)}
        if stale:
            names = min(stale) if len(stale) == 1 else f"{min(stale)} to {max(stale)}"
            report["notes"].append(f"views of an earlier run removed from the output folder: {len(stale)} ({names})")
        self._staged.write(REPORT, to_json(report))
        self._staged.commit(remove=stale)

    def __enter__(self) -> FolderSink:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._staged is not None:
            self._staged.discard()


def _earlier(folder: Path) -> set[str]:
    """The names of views that the report in `folder` lists and that are there; none where there is no such report."""
    path = folder / REPORT
    if not path.is_file():
        return set()
    try:
        names = [str(view["file"]) for view in json.loads(path.read_bytes())["views"]]
    except (LookupError, TypeError, ValueError):  # somebody else's report.json: nothing here is known to be ours
        return set()
    return {name for name in names if re.fullmatch(r"view_\d+_\d+\.png", name) and (folder / name).is_file()}


class PngSink:
    """One view as a PNG, into a binary file."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def begin(self, count: int) -> None:
        """Refuses more than one view."""
        if count != 1:
            raise InvalidOption(f"format: png holds one view and {count} are asked for; give zip or npz, or one view")

    def add(self, view: tuple[int, int], pixels: Pixels) -> str:
        """Writes the PNG."""
        self._file.write(_png(pixels))
        return file_name(view)

    def finish(self, report: Report) -> None:
        """A PNG has no room for a report."""


class ZipSink:
    """The PNGs and `report.json` in a zip. PNGs are stored as they are: they don't shrink any further."""

    def __init__(self, file: IO[bytes]) -> None:
        self._zip = zipfile.ZipFile(file, "w", zipfile.ZIP_STORED)

    def begin(self, count: int) -> None:
        """A zip holds any number of views."""

    def add(self, view: tuple[int, int], pixels: Pixels) -> str:
        """Adds a PNG."""
        name = file_name(view)
        self._zip.writestr(zipfile.ZipInfo(name, _EPOCH), _png(pixels))
        return name

    def finish(self, report: Report) -> None:
        """Adds the report and the zip's directory."""
        self._zip.writestr(zipfile.ZipInfo(REPORT, _EPOCH), to_json(report), zipfile.ZIP_DEFLATED)
        self._zip.close()

    def discard(self) -> None:
        """Lets go of the file, which holds nothing of use."""
        self._zip.close()


class NpzSink:
    """NumPy's npz: `views` (n, H, W, C), `positions` (n, 2) as (v, u), `report` (JSON text). Written view by view."""

    def __init__(self, file: IO[bytes]) -> None:
        self._zip = zipfile.ZipFile(file, "w", zipfile.ZIP_STORED)
        self._count = 0
        self._positions: list[tuple[int, int]] = []
        self._member: IO[bytes] | None = None

    def begin(self, count: int) -> None:
        """Keeps the count for the array's header."""
        self._count = count

    def add(self, view: tuple[int, int], pixels: Pixels) -> str:
        """Appends the pixels to `views`; all views have one shape and type."""
        if self._member is None:
            self._member = self._zip.open(zipfile.ZipInfo("views.npy", _EPOCH), "w", force_zip64=True)
            header = {
                "descr": np.lib.format.dtype_to_descr(pixels.dtype),
                "fortran_order": False,
                "shape": (self._count, *pixels.shape),
            }
            np.lib.format.write_array_header_1_0(self._member, header)
        self._member.write(np.ascontiguousarray(pixels).data)
        self._positions.append(view)
        return file_name(view)

    def finish(self, report: Report) -> None:
        """Adds `positions` and `report`."""
        assert self._member is not None  # noqa: S101 - a reconstruction has at least one view
        self._member.close()
        self._array("positions", np.array(self._positions, np.int32))
        self._array("report", np.array(to_json(report).decode()))
        self._zip.close()

    def discard(self) -> None:
        """Lets go of the file, which holds nothing of use."""
        if self._member is not None:
            self._member.close()
        self._zip.close()

    def _array(self, name: str, array: NDArray[Any]) -> None:
        buffer = io.BytesIO()
        np.lib.format.write_array(buffer, array, allow_pickle=False)
        self._zip.writestr(zipfile.ZipInfo(f"{name}.npy", _EPOCH), buffer.getvalue())


SINKS: dict[str, Callable[[IO[bytes]], Sink]] = {"png": PngSink, "zip": ZipSink, "npz": NpzSink}


class FileSink:
    """One file in the format that was asked for; without one, a PNG for one view and a zip for several."""

    def __init__(self, file: IO[bytes], wanted: str | None) -> None:
        if wanted is not None and wanted not in FORMATS:
            raise InvalidOption(f"format: {wanted[:40]!r} is not known; give {', '.join(FORMATS)}")
        self._file = file
        self._wanted = wanted
        self._sink: Sink | None = None
        self.format = "zip"
        """Known from `begin` on."""

    def begin(self, count: int) -> None:
        """Chooses the format."""
        self.format = self._wanted or ("png" if count == 1 else "zip")
        self._sink = SINKS[self.format](self._file)
        self._sink.begin(count)

    def add(self, view: tuple[int, int], pixels: Pixels) -> str:
        """Passes the view on."""
        assert self._sink is not None  # noqa: S101 - begin was called: Sink's contract
        return self._sink.add(view, pixels)

    def finish(self, report: Report) -> None:
        """Completes the file."""
        assert self._sink is not None  # noqa: S101
        self._sink.finish(report)

    def __enter__(self) -> FileSink:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # A zip that is left open writes its directory when it is collected, into a file that is closed by then.
        if kind is not None and isinstance(self._sink, ZipSink | NpzSink):
            self._sink.discard()
