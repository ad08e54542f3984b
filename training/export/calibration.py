"""Examples for the calibration of int8 networks: views and their truth."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch

from ciir.models.light_field.planes import describe_window
from ciir.models.light_field.windows import WINDOW_SIDE, select_axis
from ciir.renderer.scenes import SCENES, load_scene
from ciir.training.data import downscale, mesh_views, pictures
from ciir.training.data.light_field.crops import STEPS_PER_BLOCK, Inputs, LightFieldCrops
from ciir.training.export.inputs import IMAGE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from ciir.training.data.mesh_views import MeshLightField
    from ciir.training.data.pictures import Picture


class Example(NamedTuple):
    """The inputs of a network and the true output."""

    inputs: dict[str, NDArray[np.float32]]
    """The inputs by name: one picture `(1, C, h, w)` in [0, 1], and for a light field the description of its window."""
    high: Picture
    """`(scale*h, scale*w, 3)`, 8 bit."""


PICTURES = 36
"""Most pictures from each folder, evenly spaced in the order of their names."""
SIDE = 128
"""Longest side of the LR view of a picture, which shows the picture's middle."""
VIEWS = 3
"""Number of views of each built-in scene, rotated, one for each size of array in `mesh_views.LENSES`."""
BATCHES, SCENES_PER_BATCH = 8, 4
"""Number of batches of layered scenes with the pictures of a folder as textures, and of scenes in a batch."""
LIGHT_FIELDS = 2
"""Number of light fields of each built-in scene: one of an array of 48x48 lenses and one of 96x96."""


def make_picture_examples(folders: Sequence[Path], scale: int) -> list[Example]:
    """Makes examples from each folder's pictures, degraded in turn by each of `downscale.KINDS`, and built-in scenes.

    Raises `ValueError` if a folder has no picture, or one can't be read or is smaller than one LR pixel.
    """
    found: list[Example] = []
    for folder in folders:
        files = [file for file in pictures.find_pictures(folder) if not file.name.endswith("_LR.png")]
        chosen = files[:: max(1, len(files) // PICTURES)][:PICTURES]
        unused = pictures.count_unused(chosen)
        for index, file in enumerate(chosen):
            kind = downscale.KINDS[index % len(downscale.KINDS)]
            read = pictures.read_rgb(file, unused=unused)
            middle = _crop_middle(read, SIDE * downscale.cell_size(kind, scale))
            try:
                found.append(_make_picture_example(*downscale.downscale_picture(kind, middle, scale)))
            except ValueError as error:
                raise ValueError(f"{file}: {error}; remove it from the folder") from error
    for name in SCENES:
        for index in range(VIEWS):
            made = mesh_views.render_pairs(load_scene(name), seed=0, index=index, scale=scale)
            found.extend(_make_picture_example(low, high) for low, high in made)
    return found


def make_light_field_examples(folders: Sequence[Path], scale: int, planes: int) -> list[Example]:
    """Makes examples for a light-field network of `planes`: layered scenes of each folder's pictures and views of
    built-in scenes. The layered scenes are like those late in training, some at the border of the grid.

    Raises `ValueError` as `training.data.light_field.crops.LightFieldCrops` does.
    """
    found: list[Example] = []
    for folder in folders:
        kinds = dict.fromkeys(downscale.KINDS, 1.0)
        crops = LightFieldCrops(
            folder,
            crop=SIDE * scale,
            scale=scale,
            batch=SCENES_PER_BATCH,
            seed=0,
            degradations=kinds,
            planes=planes,
        )
        for number in range(BATCHES):
            inputs, high = crops.make_batch(number * STEPS_PER_BLOCK)
            found.extend(_split_batch(inputs, high))
    for name in SCENES:
        for index in range(LIGHT_FIELDS):
            rendered = mesh_views.render_window(load_scene(name), seed=0, index=index)
            found.extend(_make_mesh_examples(rendered, planes))
    return found


def _make_picture_example(low: Picture, high: Picture) -> Example:
    return Example({IMAGE.name: pictures.convert_to_input(low)}, high)


def _split_batch(inputs: Inputs, high: torch.Tensor) -> Iterator[Example]:
    """Yields an example for each light field of a batch. `high`: `(N, 3, scale*h, scale*w)` in [0, 1]."""
    truths = high.mul(255).round().byte().permute(0, 2, 3, 1).numpy()
    for number, truth in enumerate(truths):
        one = slice(number, number + 1)
        parts = inputs._replace(image=inputs.image[one], around=inputs.around[one])._asdict()
        yield Example({name: part.numpy() for name, part in parts.items()}, truth)


def _make_mesh_examples(field: MeshLightField, planes: int) -> Iterator[Example]:
    """Yields an example for each kind of array from the light field of a mesh."""
    rows, cols = (select_axis(place, WINDOW_SIDE) for place in field.own)
    window = [torch.from_numpy(part.copy()) for part in describe_window(rows, cols, field.disparities, planes)]
    for kind, views in field.views.items():
        image, around = (part[None].float().div(255) for part in (field.colours[kind], views))
        yield from _split_batch(Inputs(image, around, *window), field.high[None].float().div(255))


def _crop_middle(photograph: Picture, side: int) -> Picture:
    height, width = photograph.shape[:2]
    top, left = max(0, height - side) // 2, max(0, width - side) // 2
    return photograph[top : top + side, left : left + side]
