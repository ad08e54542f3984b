"""Training crops for light-field networks: a view, the window of views around it, and its truth.

Layered scenes (`training.data.layered_scenes`) are made during the run, views of meshes (`training.data.mesh_views`)
before it. Some crops have windows of another scene, noise, or disparities that no plane matches.
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
from ciir.training.data import degrade, downscale, layered_scenes
from ciir.training.data.crops import RENDERED, check_degradations
from ciir.training.data.layered_scenes import LUMA
from ciir.training.data.pictures import MEMORY, Pictures

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ciir.training.data.mesh_views import MeshLightField
    from ciir.training.data.pictures import Picture

STEPS_PER_BLOCK = 6
"""Steps that share scenes, with different places, rotations and degradations."""
KEPT_BLOCKS = 3
"""Blocks of steps whose scenes are kept: enough for `2 * STEPS_PER_BLOCK + 1` steps that are prefetched."""
MARGIN = 12
"""LR pixels by which scenes are larger than crops."""
GRIDS = ((4, 9, 0.5), (1, 9, 0.14), (0, 9, 0.18), (1, 3, 0.09), (0, 3, 0.09))
"""Index of a view along a side of a grid, the grid's side, and the share of such windows, border included."""
MISMATCHED = 0.04
"""Share of crops whose other views show another scene."""
NOISE = (0.01, 0.1)
"""Share of crops under heavy noise, different in each view, and its standard deviation."""
GRAIN = (0.15, 2 / 255)
"""Share of crops with camera grain in the LR views, and its largest standard deviation."""


class Inputs(NamedTuple):
    """The inputs of `training.networks.light_field.LightFieldGenerator`, by name."""

    image: Tensor
    around: Tensor
    rows: Tensor
    cols: Tensor


class Window(NamedTuple):
    """Which views of a window are there, `(WINDOW_SIDE,)` each: see `models.light_field.windows.Axis.present`."""

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
        eased: int = 0,
        memory: int = MEMORY,
    ) -> None:
        """`folder`: pictures for the textures of layers; those smaller than `layered_scenes.TEXTURE` are skipped.

        `crop`: HR side in pixels. `degradations`: kind -> weight, of `training.data.downscale.KINDS`, and with `meshes`
        of `training.data.crops.RENDERED`. `eased`: steps over which windows at the border and corrupted crops reach
        their shares: with them from the start the network does not learn to use the other views.

        Raises `ValueError` where one of these is wrong.
        """
        if scale != 2:
            raise ValueError(f"scale is {scale}; light fields are upscaled by 2: give that")
        known = (*downscale.KINDS, *RENDERED) if meshes else downscale.KINDS
        check_degradations(crop, scale, degradations, known)
        self.side, self.batch, self.seed = crop // scale, batch, seed
        self.eased = eased
        self.pictures = _LargePictures(Pictures(folder, memory=memory))
        self.kinds = list(degradations)
        weights = np.array(list(degradations.values()), float)
        self.shares = weights / weights.sum()
        self.meshes = _render_meshes(meshes, seed, self.side)
        self._lock = threading.Lock()
        self._blocks: dict[int, tuple[Tensor, Tensor]] = {}

    def make_batch(self, step: int) -> tuple[Inputs, Tensor]:
        """The inputs, `batch` crops of LR side `crop/scale`, and their truth `(batch, 3, crop, crop)` in [0, 1]."""
        random = np.random.default_rng((self.seed, step))
        rendered = [kind for kind in self.kinds if kind in RENDERED]
        share = sum(self.shares[self.kinds.index(kind)] for kind in rendered)
        if random.random() < share:
            image, around, high = self._crop_meshes(random)
        else:
            image, around, high = self._crop_scenes(random, step)
        ease = min(1.0, step / self.eased) if self.eased else 1.0
        window = _draw_window(random) if random.random() < ease else _draw_window(random, GRIDS[:1])
        image, around = _corrupt(random, image, around, ease)
        return _augment(random, image, around, high, window)

    def _crop_scenes(self, random: np.random.Generator, step: int) -> tuple[Tensor, Tensor, Tensor]:
        views, colours = self._made(step // STEPS_PER_BLOCK)
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
        return image, around, high

    def _crop_meshes(self, random: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
        rendered = [kind for kind in self.kinds if kind in RENDERED]
        shares = np.array([self.shares[self.kinds.index(kind)] for kind in rendered])
        crops = []
        for _ in range(self.batch):
            kind = rendered[int(random.choice(len(rendered), p=shares / shares.sum()))]
            field = self.meshes[int(random.integers(len(self.meshes)))]
            y, x = (int(random.integers(length - self.side + 1)) for length in field.views[kind].shape[1:])
            rows, cols = slice(y, y + self.side), slice(x, x + self.side)
            around, high = degrade.crop_pair(field.views[kind], field.high, 2, rows, cols)
            crops.append((field.colours[kind][:, rows, cols], around, high))
        image, around, high = (torch.stack(each).float().div(255) for each in zip(*crops, strict=True))
        return image, around, high

    def _made(self, block: int) -> tuple[Tensor, Tensor]:
        """Returns the scenes of a block of steps, 8 bit. The last blocks are kept, as threads may ask in any order."""
        with self._lock:
            if block not in self._blocks:
                random = np.random.default_rng((self.seed, block, 1))
                made = layered_scenes.make_scenes(
                    random, self.pictures, self.batch, side=self.side + MARGIN, window=WINDOW_SIDE
                )
                views, colours = (part.clamp(0, 1).mul(255).round().byte() for part in made)
                last = sorted(self._blocks)[1 - KEPT_BLOCKS :]
                self._blocks = {**{number: self._blocks[number] for number in last}, block: (views, colours)}
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


def _draw_window(random: np.random.Generator, grids: Sequence[tuple[int, int, float]] = GRIDS) -> Window:
    """Draws which rows and columns of the window are inside the grid, by the shares of `grids`."""
    shares = np.array([share for _, _, share in grids])
    rows, cols = (select_axis(*grids[int(random.choice(len(grids), p=shares / shares.sum()))][:2]) for _ in range(2))
    return Window(torch.from_numpy(rows.present), torch.from_numpy(cols.present))


def _degrade(kind: str, fine: Tensor) -> degrade.Pair:
    """Degrades what was sampled `layered_scenes.FINE` times as finely as LR, 8 bit `(C, H, W)`."""
    if kind == "point":
        return degrade.make_pair(kind, fine, 2)
    high = degrade.box(fine[None].float().div(255), layered_scenes.FINE // 2)[0]
    return degrade.make_pair(kind, high.mul(255).round().byte(), 2)


def _compute_luma(image: Tensor) -> Tensor:
    return torch.einsum("nchw,c->nhw", image, image.new_tensor(LUMA))[:, None]


def _corrupt(random: np.random.Generator, image: Tensor, around: Tensor, ease: float) -> tuple[Tensor, Tensor]:
    """Gives some crops the views of another scene, and adds noise or grain to some.

    `ease`: factor on the shares, up to 1.
    """

    def share(of: float) -> Tensor:
        return torch.from_numpy(random.random(len(image)) < of)[:, None, None, None]

    def normal(like: Tensor) -> Tensor:
        return torch.from_numpy(random.standard_normal(like.shape, np.float32))

    around = torch.where(share(MISMATCHED * ease), around.roll(1, 0), around)
    seldom, strong = NOISE
    noisy = share(seldom * ease)
    image = torch.where(noisy, (image + strong * normal(image)).clamp(0, 1), image)
    around = torch.where(noisy, (around + strong * normal(around)).clamp(0, 1), around)
    often, most = GRAIN
    grain = share(often * ease) * torch.from_numpy(random.uniform(0, most, (len(image), 1, 1, 1)).astype(np.float32))
    image = (image + grain * normal(image)).clamp(0, 1)
    around = (around + grain * sum(weight**2 for weight in LUMA) ** 0.5 * normal(around)).clamp(0, 1)
    around = around.clone()
    around[:, WINDOW_SIDE * WINDOW_SIDE // 2] = _compute_luma(image)[:, 0]
    return image, around


def _augment(
    random: np.random.Generator, image: Tensor, around: Tensor, high: Tensor, window: Window
) -> tuple[Inputs, Tensor]:
    """Flips all crops of a batch vertically, horizontally and along the diagonal, each half of the time."""
    rows, cols = window
    around = around.reshape(-1, WINDOW_SIDE, WINDOW_SIDE, *around.shape[2:])
    if random.random() < 0.5:
        image, around, high, rows = image.flip(2), around.flip(1, 3), high.flip(2), rows.flip(0)
    if random.random() < 0.5:
        image, around, high, cols = image.flip(3), around.flip(2, 4), high.flip(3), cols.flip(0)
    if random.random() < 0.5:
        image, high, around = image.transpose(2, 3), high.transpose(2, 3), around.transpose(1, 2).transpose(3, 4)
        rows, cols = cols, rows
    return Inputs(image.contiguous(), around.flatten(1, 2).contiguous(), rows, cols), high.contiguous()


def _render_meshes(meshes: Sequence[str | Path], seed: int, side: int) -> list[MeshLightField]:
    """Renders the light fields of mesh files that have at least `side` LR pixels: see `mesh_views.render_window`.

    Raises `ValueError` where none is as large.
    """
    if not meshes:
        return []
    from ciir.training.data import mesh_views

    largest = mesh_views.LENSES[-1]
    if side > largest:
        raise ValueError(
            f"meshes are rendered for crops of up to {2 * largest} pixels, not {2 * side}; set a smaller one"
        )
    models = [mesh_views.read_mesh(path) for path in meshes]
    tqdm.write(f"rendering light fields of {len(models)} meshes: minutes for ten", file=sys.stderr)
    made = []
    for number, model in enumerate(tqdm(models, disable=None, desc="rendering", unit="mesh")):
        for index in range(mesh_views.PICTURES):
            seen = mesh_views.render_window(model, seed=seed, index=number * mesh_views.PICTURES + index)
            if min(seen.high.shape[1:]) >= 2 * side:
                made.append(seen)
    rendered = len(models) * mesh_views.PICTURES
    if len(made) < rendered:
        left_out = f"{rendered - len(made)} of {rendered} light fields of meshes are left out"
        tqdm.write(f"{left_out}: they are smaller than the crop of {2 * side}x{2 * side} pixels", file=sys.stderr)
    return made
