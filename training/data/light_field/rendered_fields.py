"""Light fields of meshes and of random scenes of solids, rendered before training, on all cores."""

from __future__ import annotations

import pickle
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from tqdm import tqdm

from ciir.cores import count_available_cores
from ciir.renderer.scene import Scene
from ciir.training.data import mesh_views
from ciir.training.data.rendered import start_process
from ciir.training.data.solids import make_solids

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from _typeshed import SupportsLenAndGetItem

    from ciir.models.light_field.windows import View
    from ciir.training.data.light_field.textures import Textures
    from ciir.training.data.mesh_views import MeshLightField
    from ciir.training.data.pictures import Picture

OWN = ((2, 0.45), (1, 0.3), (0, 0.25))
"""Row or column in the window of the view to be upscaled, and the share of such windows. The others are mirrored."""
SOLID_FIELDS, EXTENT = 5, 96
"""Most solids in a rendered scene, and their extent before they are framed, which determines the texels."""


def draw_own(random: np.random.Generator) -> View:
    """Draws the row and column, in the window, of the view to be upscaled, by the shares of `OWN`."""
    places, shares = zip(*OWN, strict=True)
    row, col = (int(random.choice(places, p=shares)) for _ in range(2))
    return row, col


def render_fields(
    meshes: Sequence[str | Path], scenes: int, textures: Textures, seed: int, side: int
) -> list[MeshLightField]:
    """Renders light fields of mesh files and of `scenes` random scenes of solids (see `mesh_views.render_window`), and
    keeps those with sides of at least `side` LR pixels.

    Raises `ValueError` if none is that large.
    """
    if not meshes and not scenes:
        return []
    largest = mesh_views.LENSES[-1]
    if side > largest:
        raise ValueError(
            f"meshes are rendered for crops of up to {2 * largest} pixels, not {2 * side}; set a smaller one"
        )
    models = [mesh_views.read_mesh(path) for path in meshes for _ in range(mesh_views.PICTURES)]
    count = len(models) + scenes
    tqdm.write(f"rendering light fields of {len(meshes)} meshes and {scenes} scenes: minutes", file=sys.stderr)
    # Forked, because otherwise each would take seconds to import torch. They use neither its threads nor a GPU.
    pool = ProcessPoolExecutor(
        count_available_cores(), get_context("fork"), _keep, (_Given(models, textures.pictures, seed),)
    )
    with pool:
        tasks = pool.map(_render_field, range(count))
        made = [pickle.loads(seen) for seen in tqdm(tasks, total=count, disable=None, desc="rendering", unit="field")]  # noqa: S301 - our own
    large = [field for field in made if min(field.high.shape[1:]) >= 2 * side]
    if len(large) < count:
        tqdm.write(
            f"{count - len(large)} of {count} light fields of meshes are left out: they are smaller than the crop of "
            f"{2 * side}x{2 * side} pixels",
            file=sys.stderr,
        )
    return large


class _Given(NamedTuple):
    """The input of the processes that render."""

    models: Sequence[Scene]
    pictures: SupportsLenAndGetItem[Picture]
    seed: int


_given: list[_Given] = []
"""The input that a process of the pool was given."""


def _keep(given: _Given) -> None:
    start_process()
    _given[:] = [given]


def _render_field(index: int) -> bytes:
    """Renders light field number `index` and pickles it, because the pool would pass each tensor as an open file."""
    models, pictures, seed = _given[0]
    random = np.random.default_rng((seed, index, 4))
    if index < len(models):
        mesh = models[index]
    else:
        count = int(random.integers(1, SOLID_FIELDS + 1))
        mesh = Scene(tuple(make_solids(random, pictures, extent=EXTENT, count=count)))
    return pickle.dumps(mesh_views.render_window(mesh, seed=seed, index=index, own=draw_own(random)))
