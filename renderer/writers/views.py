"""Writes views that are in memory, or a whole light field, in the format that the name asks for."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.folder import FolderWriter
from ciir.renderer.writers.formats import BY_SUFFIX
from ciir.renderer.writers.pictures import SUFFIXES, encode

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Writer


def save_light_field(views: Pixels, path: Path) -> None:
    """Writes `views`, `(V, U, H, W, C)`: as an elemental image array into a picture, else view by view.

    Raises as `save_views` does.
    """
    suffix = path.suffix.lower()
    if suffix in SUFFIXES:
        v, u, rows, cols, channels = views.shape
        eia = views.transpose(2, 0, 3, 1, 4).reshape(rows * v, cols * u, channels)
        with _named_errors(path), replacing(path) as file:
            file.write(encode(eia, suffix))
    else:
        save_views({index: views[index] for index in np.ndindex(views.shape[0], views.shape[1])}, {}, path)


def save_views(views: Mapping[View, Pixels], report: Mapping[str, Any], path: Path) -> None:
    """Writes `views`, `(H, W, C)` by (v, u), and `report` where the format holds one, to a file or a folder.

    Raises `InvalidOption` where `path` can't be written or the format can't hold the views.
    """
    suffix = path.suffix.lower()
    if suffix in BY_SUFFIX:
        with _named_errors(path), replacing(path) as file, BY_SUFFIX[suffix].open(file) as writer:
            _write(views, report, writer)
    elif suffix and not path.is_dir():
        known = ", ".join(BY_SUFFIX)
        raise InvalidOption(f"{path}: {suffix} can't be written; end the name with {known}, or with none for a folder")
    else:
        with _named_errors(path), FolderWriter(path) as writer:
            _write(views, report, writer)


@contextmanager
def _named_errors(path: Path) -> Iterator[None]:
    """Raises `InvalidOption` for an error of the system."""
    try:
        yield
    except OSError as error:
        raise InvalidOption(f"{path}: {error.strerror}; name a place that can be written") from error


def _write(views: Mapping[View, Pixels], report: Mapping[str, Any], writer: Writer) -> None:
    writer.begin(len(views), next(iter(views.values()))[:1, :1])
    written = []
    for (v, u), picture in views.items():
        height, width = picture.shape[:2]
        written.append({"v": v, "u": u, "file": writer.write((v, u), picture), "height": height, "width": width})
    writer.finish({"notes": [], **report, "views": written})
