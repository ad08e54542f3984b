"""Views by their places in a light field, of which some may be missing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ciir.errors import InputError
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.registry import is_picture
from ciir.renderer.readers.view_set import reader
from ciir.training.data.light_field.views import drop_alpha, read_light_field
from ciir.training.evaluation.folders import is_set, read_picture

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from ciir.renderer.readers.layout import Layout
    from ciir.renderer.views import DepthSense, View


class PlacedViews(NamedTuple):
    """Views of a light field."""

    views: dict[View, NDArray[Any]]
    """(v, u) -> `(H, W, C)`, all of one size."""
    grid: tuple[int, int] | None
    """Rows and columns of the light field; None if unknown, (1, 1) for one picture whose place is unknown."""
    depth_sense: DepthSense
    notes: tuple[str, ...]

    def place_alone(self) -> PlacedViews:
        """Returns the one view as a picture whose place is unknown."""
        (view,) = self.views.values()
        return self._replace(views={(0, 0): view}, grid=(1, 1))


def read_all(path: Path, layout: Layout | None) -> PlacedViews:
    """Reads all views of a light field as `read_light_field` does, or one picture. Raises `ValueError`."""
    if layout is None and path.is_file() and is_picture(path.name):
        field = read_picture(path.read_bytes(), path)
    else:
        field = read_light_field(path, layout=layout, least=1, takes_one=True)
    grid = field.views.shape[:2]
    views: dict[View, NDArray[Any]] = {(v, u): field.views[v, u] for v, u in np.ndindex(grid)}
    return PlacedViews(views, grid, field.depth_sense, field.notes)


def read_some(path: Path) -> PlacedViews | None:
    """Reads a folder or zip with some views that `ciir reconstruct` wrote; returns None for anything else.

    Raises `ValueError` if a picture is corrupt or see-through, or they differ in size.
    """
    if not is_set(path):
        return None
    bundle = Bundle.from_path(path)
    try:
        found = reader.read_some(bundle.files, name=bundle.name, limits=bundle.limits)
    except InputError as error:
        raise ValueError(f"{path}: {str(error).removeprefix(f'{bundle.name}: ')}") from error
    if found is None:
        return None
    field = drop_alpha(found.field, path)
    return PlacedViews(dict(zip(found.places, field.views[0], strict=True)), found.grid, field.depth_sense, ())
