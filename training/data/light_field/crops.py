"""Training crops for light-field networks: a view, the window of views around it, and its truth.

Layered scenes (`layered_scenes`) are made during the run, views of solids and meshes
(`training.data.mesh_views`) before it. The views of some crops differ as captured ones do (`camera_differences`).
"""

from __future__ import annotations

import sys
import threading
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from ciir.models.light_field.windows import WINDOW_SIDE, select_axis
from ciir.renderer.scene import Scene
from ciir.training.data import downscale
from ciir.training.data.crops import RENDERED, check_degradations
from ciir.training.data.light_field import layered_scenes
from ciir.training.data.light_field.camera_differences import differ
from ciir.training.data.pictures import MEMORY, Pictures
from ciir.training.data.solids import make_solids

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ciir.training.data.mesh_views import MeshLightField
    from ciir.training.data.pictures import Picture

STEPS_PER_BLOCK = 9
"""Steps that share scenes, with different places, rotations and degradations."""
KEPT_BLOCKS = 3
"""Blocks of steps whose scenes are kept: enough for `2 * STEPS_PER_BLOCK + 1` steps that are prefetched."""
MARGIN = 12
"""LR pixels by which scenes are larger than crops."""
OWN = ((2, 0.45), (1, 0.3), (0, 0.25))
"""Row or column in the window of the view to be upscaled, and the share of such windows; the others are mirrored."""
SMALL_GRIDS = 0.25
"""Share of windows that are cut to the 3x3 views around, or as many as are there."""
SOLID_FIELDS, EXTENT = 5, 96
"""Solids in a rendered scene, at most, and their extent before they are framed: texels are drawn by it."""
View = tuple[int, int]
"""Row and column of a view in its window."""


class Inputs(NamedTuple):
    """The inputs of `training.networks.light_field.LightFieldGenerator`, by name."""

    image: Tensor
    around: Tensor
    rows: Tensor
    cols: Tensor


class LightFieldCrops:
    """Random crops of light fields with their truth. The batch of step `s` depends only on the seed and `s`."""

    def __init__(
        self,
        folder: Path,
        *,
        crop: int,
        scale: int,
        batch: int,
        seed: int,
        degradations: Mapping[str, float],
        meshes: Sequence[str | Path] = (),
        scenes: int = 0,
        eased: int = 0,
        memory: int = MEMORY,
    ) -> None:
        """`folder`: pictures for the textures of layers; those smaller than `layered_scenes.TEXTURE` are skipped.

        `crop`: HR side in pixels. `degradations`: kind -> weight, of `training.data.downscale.KINDS`, and with `meshes`
        (files) or `scenes` random scenes of solids, of `training.data.crops.RENDERED`. `eased`: steps over which
        windows of small grids and changed crops reach their shares: with them from the start the network does not
        learn to use the other views.

        Raises `ValueError` where one of these is wrong.
        """
        if scale != 2:
            raise ValueError(f"scale is {scale}; light fields are upscaled by 2: give that")
        known = (*downscale.KINDS, *RENDERED) if meshes or scenes else downscale.KINDS
        check_degradations(crop, scale, degradations, known)
        self.side, self.batch, self.seed = crop // scale, batch, seed
        self.eased = eased
        self.pictures = _LargePictures(Pictures(folder, memory=memory))
        self.kinds = list(degradations)
        weights = np.array(list(degradations.values()), float)
        self.shares = weights / weights.sum()
        self.meshes = _render_fields(meshes, scenes, self.pictures, seed, self.side)
        self._lock = threading.Lock()
        self._blocks: dict[int, tuple[View, Tensor, Tensor]] = {}

    def make_batch(self, step: int) -> tuple[Inputs, Tensor]:
        """The inputs, `batch` crops of LR side `crop/scale`, and their truth `(batch, 3, crop, crop)` in [0, 1]."""
        random = np.random.default_rng((self.seed, step))
        rendered = [kind for kind in self.kinds if kind in RENDERED]
        share = sum(self.shares[self.kinds.index(kind)] for kind in rendered)
        ease = min(1.0, step / self.eased) if self.eased else 1.0
        if random.random() < share:
            own, (image, around, high) = self._crop_meshes(random)
        else:
            own, (image, around, high) = self._crop_scenes(random, step)
        image, around = differ(random, image, around, own, ease)
        return _augment(random, image, around, high, own, is_small=bool(random.random() < SMALL_GRIDS * ease))

    def _crop_scenes(self, random: np.random.Generator, step: int) -> tuple[View, tuple[Tensor, Tensor, Tensor]]:
        own, views, colours = self._made(step // STEPS_PER_BLOCK)
        kinds = [kind for kind in self.kinds if kind not in RENDERED]
        shares = np.array([self.shares[self.kinds.index(kind)] for kind in kinds])
        crops = []
        for scene in range(self.batch):
            y, x = (layered_scenes.FINE * int(random.integers(MARGIN + 1)) for _ in range(2))
            extent = layered_scenes.FINE * self.side
            part = (slice(None), slice(y, y + extent), slice(x, x + extent))
            kind = kinds[int(random.choice(len(kinds), p=shares / shares.sum()))]
            around, _ = _degrade(kind, views[scene][part])
            image, high = _degrade(kind, colours[scene][part])
            crops.append((image, around, high))
        image, around, high = (torch.stack(each).float().div(255) for each in zip(*crops, strict=True))
        return own, (image, around, high)

    def _crop_meshes(self, random: np.random.Generator) -> tuple[View, tuple[Tensor, Tensor, Tensor]]:
        rendered = [kind for kind in self.kinds if kind in RENDERED]
        shares = np.array([self.shares[self.kinds.index(kind)] for kind in rendered])
        crops = []
        own = self.meshes[int(random.integers(len(self.meshes)))].own
        fields = [field for field in self.meshes if field.own == own]
        for _ in range(self.batch):
            kind = rendered[int(random.choice(len(rendered), p=shares / shares.sum()))]
            field = fields[int(random.integers(len(fields)))]
            y, x = (int(random.integers(length - self.side + 1)) for length in field.views[kind].shape[1:])
            rows, cols = slice(y, y + self.side), slice(x, x + self.side)
            high = field.high[:, 2 * y : 2 * (y + self.side), 2 * x : 2 * (x + self.side)]
            crops.append((field.colours[kind][:, rows, cols], field.views[kind][:, rows, cols], high))
        image, around, high = (torch.stack(each).float().div(255) for each in zip(*crops, strict=True))
        return own, (image, around, high)

    def _made(self, block: int) -> tuple[View, Tensor, Tensor]:
        """Returns the scenes of a block of steps, 8 bit. The last blocks are kept, as threads may ask in any order."""
        with self._lock:
            if block not in self._blocks:
                random = np.random.default_rng((self.seed, block, 1))
                own = _draw_own(random)
                made = layered_scenes.make_scenes(
                    random, self.pictures, self.batch, side=self.side + MARGIN, window=WINDOW_SIDE, own=own
                )
                views, colours = (part.clamp(0, 1).mul(255).round().byte() for part in made)
                last = sorted(self._blocks)[1 - KEPT_BLOCKS :]
                self._blocks = {**{number: self._blocks[number] for number in last}, block: (own, views, colours)}
            return self._blocks[block]


class _LargePictures:
    """The pictures that are large enough for the texture of a layer."""

    def __init__(self, pictures: Pictures) -> None:
        self._pictures = pictures
        self._large = [number for number, size in enumerate(pictures.sizes) if min(size) >= layered_scenes.TEXTURE]
        if not self._large:
            raise ValueError(
                f"train: no picture is as large as {layered_scenes.TEXTURE}x{layered_scenes.TEXTURE}; name others"
            )

    def __len__(self) -> int:
        return len(self._large)

    def __getitem__(self, index: int) -> Picture:
        return self._pictures[self._large[index]]


def _draw_own(random: np.random.Generator) -> View:
    """Draws the row and the column in the window of the view to be upscaled, by the shares of `OWN`."""
    places, shares = zip(*OWN, strict=True)
    row, col = (int(random.choice(places, p=shares)) for _ in range(2))
    return row, col


def _degrade(kind: str, fine: Tensor) -> tuple[Tensor, Tensor]:
    """LR and HR, 8 bit `(C, h, w)`, of what was sampled `layered_scenes.FINE` times as finely as LR, `(C, H, W)`."""
    picture = fine.permute(1, 2, 0).numpy()
    if kind != "point":
        picture = downscale.downscale_picture("box", picture, layered_scenes.FINE // 2).low
    low, high = (torch.from_numpy(part).permute(2, 0, 1) for part in downscale.downscale_picture(kind, picture, 2))
    return low, high


def _augment(
    random: np.random.Generator, image: Tensor, around: Tensor, high: Tensor, own: View, *, is_small: bool
) -> tuple[Inputs, Tensor]:
    """Flips all crops of a batch vertically, horizontally and along the diagonal, each half of the time, and cuts
    windows of a small grid.
    """
    row, col = own
    last = WINDOW_SIDE - 1
    around = around.reshape(-1, WINDOW_SIDE, WINDOW_SIDE, *around.shape[2:])
    if random.random() < 0.5:
        image, around, high, row = image.flip(2), around.flip(1, 3), high.flip(2), last - row
    if random.random() < 0.5:
        image, around, high, col = image.flip(3), around.flip(2, 4), high.flip(3), last - col
    if random.random() < 0.5:
        image, high, around = image.transpose(2, 3), high.transpose(2, 3), around.transpose(1, 2).transpose(3, 4)
        row, col = col, row
    if is_small:
        top, left = (min(max(at - int(random.integers(3)), 0), WINDOW_SIDE - 3) for at in (row, col))
        small = around[:, top : top + 3, left : left + 3]
        around = image.new_zeros(around.shape)
        around[:, :3, :3] = small
        rows, cols = select_axis(row - top, 3), select_axis(col - left, 3)
    else:
        rows, cols = select_axis(row, WINDOW_SIDE), select_axis(col, WINDOW_SIDE)
    present = (torch.from_numpy(axis.present) for axis in (rows, cols))
    return Inputs(image.contiguous(), around.flatten(1, 2).contiguous(), *present), high.contiguous()


def _render_fields(
    meshes: Sequence[str | Path], scenes: int, pictures: _LargePictures, seed: int, side: int
) -> list[MeshLightField]:
    """Renders light fields of mesh files and of `scenes` random scenes of solids that have at least `side` LR pixels:
    see `mesh_views.render_window`.

    Raises `ValueError` where none is as large.
    """
    if not meshes and not scenes:
        return []
    from ciir.training.data import mesh_views

    largest = mesh_views.LENSES[-1]
    if side > largest:
        raise ValueError(
            f"meshes are rendered for crops of up to {2 * largest} pixels, not {2 * side}; set a smaller one"
        )
    models = [mesh_views.read_mesh(path) for path in meshes for _ in range(mesh_views.PICTURES)]
    tqdm.write(f"rendering light fields of {len(meshes)} meshes and {scenes} scenes: minutes", file=sys.stderr)
    made = []
    for index in tqdm(range(len(models) + scenes), disable=None, desc="rendering", unit="light field"):
        random = np.random.default_rng((seed, index, 4))
        mesh = models[index] if index < len(models) else _make_scene(random, pictures)
        seen = mesh_views.render_window(mesh, seed=seed, index=index, own=_draw_own(random))
        if min(seen.high.shape[1:]) >= 2 * side:
            made.append(seen)
    left_out = len(models) + scenes - len(made)
    if left_out:
        tqdm.write(
            f"{left_out} of {left_out + len(made)} light fields of meshes are left out: they are smaller than the crop "
            f"of {2 * side}x{2 * side} pixels",
            file=sys.stderr,
        )
    return made


def _make_scene(random: np.random.Generator, pictures: _LargePictures) -> Scene:
    return Scene(tuple(make_solids(random, pictures, extent=EXTENT, count=int(random.integers(1, SOLID_FIELDS + 1)))))
