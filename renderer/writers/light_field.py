"""Writes a whole light field, in the format that the name asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.writers import formats, pictures
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.folder import FolderWriter

if TYPE_CHECKING:
    from pathlib import Path

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.writers.writer import Writer


def save_light_field(views: Pixels, path: Path) -> None:
    """Writes `views`, `(V, U, H, W, C)`: as an elemental image array into a picture, else view by view.

    Raises `InvalidOption` where `path` can't be written or the format can't hold the pixels.
    """
    suffix = path.suffix.lower()
    if suffix in pictures.BY_SUFFIX:
        v, u, rows, cols, channels = views.shape
        eia = views.transpose(2, 0, 3, 1, 4).reshape(rows * v, cols * u, channels)
        with replacing(path) as file:
            file.write(pictures.encode(eia, suffix))
    elif suffix in formats.BY_SUFFIX:
        with replacing(path) as file, formats.BY_SUFFIX[suffix].open(file) as writer:
            _write(views, writer)
    elif suffix and not path.is_dir():
        known = ", ".join([*pictures.SUFFIXES, ".zip", ".npz"])
        raise InvalidOption(f"{path}: {suffix} can't be written; end the name with {known}, or with none for a folder")
    else:
        with FolderWriter(path) as writer:
            _write(views, writer)


def _write(views: Pixels, writer: Writer) -> None:
    written: list[dict[str, Any]] = []
    count_v, count_u, height, width, _ = views.shape
    writer.begin(count_v * count_u, views[0, 0, :1, :1])
    for v, u in np.ndindex(count_v, count_u):
        name = writer.write((v, u), views[v, u])
        written.append({"v": v, "u": u, "file": name, "height": height, "width": width})
    writer.finish({"views": written, "notes": []})
