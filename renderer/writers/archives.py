"""Writes views into one archive: a zip of PNGs, or NumPy's npz."""

from __future__ import annotations

import io
import zipfile
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import REPORT, ZIP_DATE, Writer, file_name, report_json

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Contents


class ZipWriter(Writer):
    """Writes the PNGs and `report.json` into a zip. PNGs are stored as they are: they don't shrink any further."""

    def __init__(self, file: IO[bytes], *_: object) -> None:
        self._zip = zipfile.ZipFile(file, "w", zipfile.ZIP_STORED)

    def begin(self, contents: Contents) -> None:
        """Accepts any views: a zip holds them all."""
        self._contents = contents

    def write(self, view: View, pixels: Pixels) -> str:
        """Adds a PNG."""
        name = self._contents.name_file(view)
        self._zip.writestr(zipfile.ZipInfo(name, ZIP_DATE), encode_png(pixels, self._contents.text))
        return name

    def finish(self, report: dict[str, Any]) -> None:
        """Adds the report and the zip's directory."""
        self._zip.writestr(zipfile.ZipInfo(REPORT, ZIP_DATE), report_json(report), zipfile.ZIP_DEFLATED)
        self._zip.close()

    def discard(self) -> None:
        """Closes the zip: left open, it would write its directory into a closed file when it is garbage-collected."""
        self._zip.close()


class NpzWriter(Writer):
    """Writes `views` (n, H, W, C), `positions` (n, 2) as (v, u) and `report` (JSON text), view by view."""

    def __init__(self, file: IO[bytes], *_: object) -> None:
        self._zip = zipfile.ZipFile(file, "w", zipfile.ZIP_STORED)
        self._count = 0
        self._positions: list[tuple[int, int]] = []
        self._member: IO[bytes] | None = None

    def begin(self, contents: Contents) -> None:
        """Keeps the count for the array's header."""
        contents.refuse_times("npz")
        self._count = len(contents.views)

    def write(self, view: View, pixels: Pixels) -> str:
        """Appends the pixels to `views`; all views have the same shape and type."""
        if self._member is None:
            self._member = self._zip.open(zipfile.ZipInfo("views.npy", ZIP_DATE), "w", force_zip64=True)
            header = {
                "descr": np.lib.format.dtype_to_descr(pixels.dtype),
                "fortran_order": False,
                "shape": (self._count, *pixels.shape),
            }
            np.lib.format.write_array_header_1_0(self._member, header)
        self._member.write(np.ascontiguousarray(pixels).data)
        self._positions.append(view)
        return file_name(view)

    def finish(self, report: dict[str, Any]) -> None:
        """Adds `positions` and `report`."""
        assert self._member is not None  # noqa: S101 - a reconstruction has at least one view
        self._member.close()
        add_array(self._zip, "positions", np.array(self._positions, np.int32))
        add_array(self._zip, "report", np.array(report_json(report).decode()))
        self._zip.close()

    def discard(self) -> None:
        """Closes the archive."""
        if self._member is not None:
            self._member.close()
        self._zip.close()


def add_array(archive: zipfile.ZipFile, name: str, array: NDArray[Any]) -> None:
    """Adds a small array to an npz."""
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, allow_pickle=False)
    archive.writestr(zipfile.ZipInfo(f"{name}.npy", ZIP_DATE), buffer.getvalue())
