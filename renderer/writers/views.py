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
from ciir.renderer.writers.writer import Contents

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from ciir.renderer.light_field import DepthSense, LightField
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Writer


def save_light_field(light_field: LightField, path: Path) -> None:
    """Writes a light field as an elemental image array into a picture, else view by view.

    Raises as `save_views` does.
    """
    suffix, views = path.suffix.lower(), light_field.views
    if suffix in SUFFIXES:
        with _named_errors(path), replacing(path) as file:
            file.write(encode(light_field.eia(), suffix))
    else:
        grid = views.shape[:2]
        save_views({index: views[index] for index in np.ndindex(grid)}, {}, path, grid, light_field.depth_sense)


def save_views(
    views: Mapping[View, Pixels],
    report: Mapping[str, Any],
    path: Path,
    grid: tuple[int, int],
    depth_sense: DepthSense,
) -> None:
    """Writes `views`, `(H, W, C)` by (v, u) of a light field with `grid` views, to a file or a folder.

    `report` goes with them where the format holds one.

    Raises `InvalidOption` where `path` can't be written or the format can't hold the views.
    """
    height, width, channels = (first := next(iter(views.values()))).shape
    contents = Contents(tuple(views), grid, height, width, channels, first.dtype, depth_sense)
    suffix = path.suffix.lower()
    if suffix in BY_SUFFIX:
        with _named_errors(path), replacing(path) as file, BY_SUFFIX[suffix].open(file) as writer:
            _write(views, report, writer, contents)
    elif suffix and not path.is_dir():
        known = ", ".join(BY_SUFFIX)
        raise InvalidOption(f"{path}: {suffix} can't be written; end the name with {known}, or with none for a folder")
    else:
        with _named_errors(path), FolderWriter(path) as writer:
            _write(views, report, writer, contents)


@contextmanager
def _named_errors(path: Path) -> Iterator[None]:
    """Raises `InvalidOption` for an error of the system."""
    try:
        yield
    except OSError as error:
        raise InvalidOption(f"{path}: {error.strerror}; name a place that can be written") from error


def _write(views: Mapping[View, Pixels], report: Mapping[str, Any], writer: Writer, contents: Contents) -> None:
    writer.begin(contents)
    written = []
    for (v, u), picture in views.items():
        height, width = picture.shape[:2]
        written.append({"v": v, "u": u, "file": writer.write((v, u), picture), "height": height, "width": width})
    writer.finish({"notes": [], **report, "views": written})
