"""Writes views as a folder of PNGs with `report.json`."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.writers.atomic_write import Staged
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import REPORT, Writer, report_json

if TYPE_CHECKING:
    from pathlib import Path

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Contents


_NAMES = re.compile(r"(view_\d+_\d+|frame_\d+)\.png")
"""Names of views and frames, as `Contents.name_file` gives them."""


class FolderWriter(Writer):
    """Writes a PNG for each view, and `report.json`; all appear together when it finishes.

    The views that an earlier report in the folder lists are removed, but never `source`, the file or folder that is the
    input. Views that no such report lists were not made by ciir. They are refused, because they would be overwritten,
    or read as views of the new light field.
    """

    def __init__(self, path: Path, source: Path | None = None) -> None:
        """Raises `InvalidOption` if `path` is a file, or a folder with views that no report lists."""
        if path.exists() and not path.is_dir():
            raise InvalidOption(f"{path}: a file is there; name a folder for the output, or remove it")
        self._path = path
        self._source = source.resolve() if source is not None else None
        self._refuse_unlisted("view")
        self._names: set[str] = set()
        self._staged: Staged | None = None

    def begin(self, contents: Contents) -> None:
        """Makes the temporary folder. Raises `InvalidOption` if frames are to come and unlisted frames are there."""
        if contents.times:
            self._refuse_unlisted("frame")
        self._contents = contents
        self._staged = Staged(self._path)

    def write(self, view: View, pixels: Pixels) -> str:
        """Writes a PNG."""
        assert self._staged is not None  # noqa: S101 - `begin` was called: the contract of Writer
        name = self._contents.name_file(view)
        self._staged.write(name, encode_png(pixels, self._contents.text))
        self._names.add(name)
        return name

    def finish(self, report: dict[str, Any]) -> None:
        """Writes the report, with a note on earlier views that are removed, and moves everything into place."""
        assert self._staged is not None  # noqa: S101
        for name in (*self._names, REPORT):
            if self._source is not None and (self._path / name).resolve() == self._source:
                raise InvalidOption(f"{self._path / name}: the input is there; give another folder for the output")
        stale = _earlier_views(self._path) - self._names
        if self._source is not None:
            stale = {name for name in stale if not (self._path / name).resolve().is_relative_to(self._source)}
        if stale:
            names = min(stale) if len(stale) == 1 else f"{min(stale)} to {max(stale)}"
            report["notes"].append(f"views of an earlier run removed from the output folder: {len(stale)} ({names})")
        self._staged.write(REPORT, report_json(report))
        self._staged.commit(remove=stale)

    def discard(self) -> None:
        """Removes the temporary folder."""
        if self._staged is not None:
            self._staged.discard()

    def _refuse_unlisted(self, kind: str) -> None:
        """Raises `InvalidOption` for pictures there named like ours of that kind, except the input, that no report
        lists.
        """
        there = {path.name for path in self._path.glob(f"{kind}_*.png") if path.resolve() != self._source}
        if others := {name for name in there if _NAMES.fullmatch(name)} - _earlier_views(self._path):
            first, last = min(others), max(others)
            what = f"{first} is" if first == last else f"{len(others)} files, {first} to {last}, are"
            raise InvalidOption(
                f"{self._path}: {what} there and not listed in a report.json of ciir; "
                "give another folder for the output, or remove them"
            )


def _earlier_views(folder: Path) -> set[str]:
    """Returns the names of views that the report in `folder` lists and that exist; empty if there is no such report."""
    path = folder / REPORT
    if not path.is_file():
        return set()
    try:
        names = [str(view["file"]) for view in json.loads(path.read_bytes())["views"]]
    except (LookupError, TypeError, ValueError):  # a report.json from another program
        return set()
    return {name for name in names if _NAMES.fullmatch(name) and (folder / name).is_file()}
