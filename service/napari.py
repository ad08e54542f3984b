"""The plugin for napari (https://napari.org): light fields as layers, with their disparity and depth planes.

`ciir/napari.yaml` is its manifest (npe2). Layers are napari's `LayerData` tuples: data, keyword arguments, kind. The
plugin imports nothing from napari. A layer with a light field has the axes v, u, y, x.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.renderer.light_field import LightField
from ciir.service.interface import open as open_light_field

if TYPE_CHECKING:
    from collections.abc import Callable

    import napari.layers
    import napari.types
    from numpy.typing import NDArray

    LayerData = tuple[NDArray[Any], dict[str, Any], str]

AXES = ("v", "u", "y", "x")


def get_reader(path: str | list[str]) -> Callable[[str], list[LayerData]] | None:
    """Returns the function that reads `path`, or None for several paths, which are several layers."""
    return read_layers if isinstance(path, str) else None


def read_layers(path: str) -> list[LayerData]:
    """Reads the light field at `path`, in any format that needs no options. Raises `ciir.Error`."""
    return [make_layer(open_light_field(path), Path(path).stem)]


def make_layer(light_field: LightField, name: str) -> LayerData:
    """Makes an image layer `(V, U, H, W[, C])` from a light field, with sliders for v and u.

    Alpha of grey views is left out.
    """
    views = light_field.views
    is_rgb = views.shape[4] > 2
    metadata = {"depth_sense": light_field.depth_sense, "notes": list(light_field.notes)}
    shown = {"name": name, "rgb": is_rgb, "axis_labels": AXES, "metadata": metadata}
    return (views if is_rgb else views[..., 0]), shown, "image"


def open_elemental_images(
    path: Path = Path(), lens_rows: int = 0, lens_columns: int = 0
) -> napari.types.LayerDataTuple:
    """Reads an elemental image array with that many lenses as a layer; with 0, any other light field.

    Raises `ciir.Error`.
    """
    lenses = (lens_rows, lens_columns) if lens_rows or lens_columns else None
    return make_layer(open_light_field(path, lenses=lenses), path.stem)


def find_disparity(layer: napari.layers.Image) -> list[napari.types.LayerDataTuple]:
    """Estimates the disparity of the centre view of the light field in `layer`, larger when nearer, and its confidence.

    Raises `ciir.Error`.
    """
    found = _read_layer(layer).disparity()
    labels = {"axis_labels": AXES[2:]}
    coloured = {"name": f"{layer.name}: disparity", "colormap": "viridis", **labels}
    confidence = {"name": f"{layer.name}: confidence", "visible": False, **labels}
    return [(found.hci, coloured, "image"), (found.confidence, confidence, "image")]


def make_planes(
    layer: napari.layers.Image, least: float = -1.0, largest: float = 1.0, number: int = 11
) -> napari.types.LayerDataTuple:
    """Makes `number` depth planes of the light field in `layer`, with a slider, from disparity `least` to `largest`.

    The largest is the nearest. The planes are the same at each v and u. Raises `ciir.Error`.
    """
    light_field = _read_layer(layer)
    disparities = np.linspace(least, largest, max(1, number))
    sign = 1 if light_field.depth_sense == "cameras" else -1
    planes: Any = np.stack(list(light_field.planes((sign * disparities).tolist())))
    data, shown, kind = make_layer(LightField(planes[:, np.newaxis]), f"{layer.name}: planes")
    grid = light_field.shape[:2]
    data = np.broadcast_to(data[:, :, np.newaxis], (len(data), *grid, *data.shape[2:]))
    metadata = {"disparities": disparities.tolist()}
    return data, shown | {"axis_labels": ("plane", *AXES), "metadata": metadata}, kind


def _read_layer(layer: napari.layers.Image) -> LightField:
    """Returns the light field that `layer` shows. Raises `InvalidOption` if it shows something else."""
    views = np.asarray(layer.data)
    sense = layer.metadata.get("depth_sense", "cameras")
    return LightField(views if layer.rgb else views[..., np.newaxis], depth_sense=sense, is_ordered=True)
