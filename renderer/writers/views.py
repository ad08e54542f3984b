"""Writes views that are in memory, in the format that the name asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.folder import FolderWriter
from ciir.renderer.writers.formats import BY_SUFFIX

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Writer


def save_views(views: Mapping[View, Pixels], report: Mapping[str, Any], path: Path) -> None:
    """Writes `views`, `(H, W, C)` by (v, u), and `report` where the format holds one, to a file or a folder.

    Raises `InvalidOption` where `path` can't be written or the format can't hold the views.
    """
    suffix = path.suffix.lower()
    if suffix in BY_SUFFIX:
        with replacing(path) as file, BY_SUFFIX[suffix].open(file) as writer:
            _write(views, report, writer)
    elif suffix and not path.is_dir():
        known = ", ".join(BY_SUFFIX)
        raise InvalidOption(f"{path}: {suffix} can't be written; end the name with {known}, or with none for a folder")
    else:
        with FolderWriter(path) as writer:
            _write(views, report, writer)


def _write(views: Mapping[View, Pixels], report: Mapping[str, Any], writer: Writer) -> None:
    writer.begin(len(views), next(iter(views.values()))[:1, :1])
    written = []
    for (v, u), picture in views.items():
        height, width = picture.shape[:2]
        written.append({"v": v, "u": u, "file": writer.write((v, u), picture), "height": height, "width": width})
    writer.finish({"notes": [], **report, "views": written})
