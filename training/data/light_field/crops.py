"""Training crops for light-field networks: a view, the window of views around it, and its truth.

Layered scenes (`layered_scenes`) are made during the run, and views of solids and meshes
(`training.data.mesh_views`) before it. The views of some crops differ like captured ones (`camera_differences`).
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ciir.models.light_field.planes import Range, describe_window
from ciir.models.light_field.windows import WINDOW_SIDE, View, select_axis
from ciir.training.data import downscale
from ciir.training.data.crops import RENDERED, check_degradations
from ciir.training.data.light_field import layered_scenes, rendered_fields
from ciir.training.data.light_field.camera_differences import differ
from ciir.training.data.light_field.degrade import degrade
from ciir.training.data.light_field.textures import Textures
from ciir.training.data.pictures import Pictures

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

STEPS_PER_BLOCK = 9
"""Number of steps that share scenes, with different places, rotations and degradations."""
KEPT_BLOCKS = 3
"""Number of blocks of steps whose scenes are kept, enough to prefetch `2 * STEPS_PER_BLOCK + 1` steps."""
MARGIN = 12
"""LR pixels by which scenes are larger than crops."""
RANGE = (0.2, 3.0)
"""Width of the disparity range of a block's scenes, LR pixels from view to view, uniform in the logarithm."""
FARTHEST = 2.0
"""Largest disparity in LR pixels, which is 4 of the truth's pixels."""
NEAR_ZERO = 0.4
"""Largest distance of the middle of a narrow range from zero."""
LOOSE = 0.25
"""Most that each end of the range given to the network lies outside that of the scenes."""
ALIKE = 6
"""Number of rendered light fields with similar ranges from which a batch's crops are cut."""
SMALL_GRIDS = 0.25
"""Share of windows that are cut to 3x3 views."""


class Inputs(NamedTuple):
    """The inputs of `training.networks.light_field.LightFieldGenerator`, by name."""

    image: Tensor
    around: Tensor
    down: Tensor
    across: Tensor
    window: Tensor


class _Batch(NamedTuple):
    """Crops of light fields whose windows are alike."""

    own: View
    disparities: Range
    image: Tensor
    """The view in colour, `(N, 3, h, w)` in [0, 1]."""
    around: Tensor
    """The luma of its window, `(N, 25, h, w)`."""
    high: Tensor
    """The truth, `(N, 3, 2*h, 2*w)`."""


class _Block(NamedTuple):
    """The scenes of a block of steps, 8 bit, `layered_scenes.FINE` times as fine as LR."""

    own: View
    disparities: Range
    views: Tensor
    colours: Tensor


class LightFieldCrops:
    """Random crops of light fields with their truth.

    The batch of step `s` depends only on the seed, the device and `s`.
    """

    def __init__(
        self,
        folder: Path,
        *,
        crop: int,
        scale: int,
        batch: int,
        seed: int,
        degradations: Mapping[str, float],
        planes: int,
        meshes: Sequence[str | Path] = (),
        scenes: int = 0,
        eased: int = 0,
        device: torch.device | None = None,
    ) -> None:
        """`folder`: pictures for the textures of layers. Those smaller than `textures.TEXTURE` are skipped.

        `crop`: HR side in pixels. `degradations`: kind -> weight. Kinds are those of `training.data.downscale.KINDS`,
        and with `meshes`, files, or `scenes`, a number of random scenes of solids, also `training.data.crops.RENDERED`.
        `planes`: the number that the network tries. `eased`: the number of steps over which windows of small grids and
        changed crops rise to their shares; with the full shares from the start, the network does not learn to use the
        other views. `device`: the device on which scenes and batches are made, by default the CPU.

        Raises `ValueError` if one of these is wrong.
        """
        if scale != 2:
            raise ValueError(f"scale is {scale}; light fields are upscaled by 2: give that")
        known = (*downscale.KINDS, *RENDERED) if meshes or scenes else downscale.KINDS
        check_degradations(crop, scale, degradations, known)
        self.side, self.batch, self.seed = crop // scale, batch, seed
        self.planes, self.eased = planes, eased
        self.device = device or torch.device("cpu")
        self.textures = Textures(Pictures(folder, memory=0), self.device)
        self.kinds = list(degradations)
        weights = np.array(list(degradations.values()), float)
        self.shares = weights / weights.sum()
        made = rendered_fields.render_fields(meshes, scenes, self.textures, seed, self.side)
        self.rendered = [field.to(self.device) for field in made]
        self._lock = threading.Lock()
        self._blocks: dict[int, _Block] = {}

    def make_batch(self, step: int) -> tuple[Inputs, Tensor]:
        """Makes inputs, `batch` crops of LR side `crop/scale`, and their truth `(batch, 3, crop, crop)` in [0, 1]."""
        random = np.random.default_rng((self.seed, step))
        share = sum(share for kind, share in zip(self.kinds, self.shares, strict=True) if kind in RENDERED)
        ease = min(1.0, step / self.eased) if self.eased else 1.0
        made = self._crop_rendered(random) if random.random() < share else self._crop_scenes(random, step)
        image, around = differ(random, made.image, made.around, made.own, ease)
        (low, high), (below, above) = made.disparities, random.uniform(0, LOOSE, 2)
        made = made._replace(image=image, around=around, disparities=Range(low - below, high + above).round_outwards())
        return _augment(random, made, self.planes, is_small=bool(random.random() < SMALL_GRIDS * ease))

    def _draw_kinds(self, random: np.random.Generator, *, rendered: bool) -> NDArray[np.str_]:
        """Draws the kind of each crop of a batch."""
        kinds = [kind for kind in self.kinds if (kind in RENDERED) == rendered]
        shares = np.array([self.shares[self.kinds.index(kind)] for kind in kinds])
        return random.choice(np.array(kinds), self.batch, p=shares / shares.sum())

    def _crop_scenes(self, random: np.random.Generator, step: int) -> _Batch:
        block = self._made(step // STEPS_PER_BLOCK)
        extent = layered_scenes.FINE * self.side
        places = layered_scenes.FINE * random.integers(0, MARGIN + 1, (self.batch, 2))
        views, colours = (
            torch.stack([scene[:, y : y + extent, x : x + extent] for scene, (y, x) in zip(of, places, strict=True)])
            for of in (block.views, block.colours)
        )
        kinds = self._draw_kinds(random, rendered=False)
        image, around, high = (
            torch.empty((self.batch, channels, side, side), device=self.device)
            for channels, side in ((3, self.side), (WINDOW_SIDE**2, self.side), (3, 2 * self.side))
        )
        for kind in np.unique(kinds):
            some = torch.from_numpy(np.flatnonzero(kinds == kind)).to(self.device)
            around[some] = degrade(kind, views[some])[0].float().div(255)
            image[some], high[some] = (part.float().div(255) for part in degrade(kind, colours[some]))
        return _Batch(block.own, block.disparities, image, around, high)

    def _crop_rendered(self, random: np.random.Generator) -> _Batch:
        first = self.rendered[int(random.integers(len(self.rendered)))]
        alike = [field for field in self.rendered if field.own == first.own]
        alike.sort(key=lambda field: sum(abs(a - b) for a, b in zip(field.disparities, first.disparities, strict=True)))
        alike = alike[:ALIKE]
        low, high = min(field.disparities.lowest for field in alike), max(field.disparities.highest for field in alike)
        crops = []
        for kind in self._draw_kinds(random, rendered=True):
            field = alike[int(random.integers(len(alike)))]
            y, x = (int(random.integers(length - self.side + 1)) for length in field.views[kind].shape[1:])
            rows, cols = slice(y, y + self.side), slice(x, x + self.side)
            truth = field.high[:, 2 * y : 2 * (y + self.side), 2 * x : 2 * (x + self.side)]
            crops.append((field.colours[kind][:, rows, cols], field.views[kind][:, rows, cols], truth))
        parts = (torch.stack(each).float().div(255) for each in zip(*crops, strict=True))
        return _Batch(first.own, Range(low, high), *parts)

    def _made(self, block: int) -> _Block:
        """Returns the scenes of a block of steps. The last blocks are kept, because threads may ask in any order."""
        with self._lock:
            if block not in self._blocks:
                random = np.random.default_rng((self.seed, block, 1))
                own, disparities = rendered_fields.draw_own(random), _draw_range(random)
                made = layered_scenes.make_scenes(
                    random,
                    self.textures,
                    self.batch,
                    side=self.side + MARGIN,
                    window=WINDOW_SIDE,
                    own=own,
                    disparities=disparities,
                )
                views, colours = (part.clamp(0, 1).mul(255).round().byte() for part in made)
                last = sorted(self._blocks)[1 - KEPT_BLOCKS :]
                kept = {number: self._blocks[number] for number in last}
                self._blocks = {**kept, block: _Block(own, disparities, views, colours)}
            return self._blocks[block]


def _draw_range(random: np.random.Generator) -> Range:
    """Draws a range of disparities. Narrow ones are near zero, because captured views are close together."""
    width = float(np.exp(random.uniform(*np.log(RANGE))))
    middle = random.uniform(-1, 1) * min(FARTHEST - width / 2, NEAR_ZERO + width / 2)
    return Range(middle - width / 2, middle + width / 2)


def _augment(random: np.random.Generator, made: _Batch, planes: int, *, is_small: bool) -> tuple[Inputs, Tensor]:
    """Flips all crops of a batch vertically, horizontally and along the diagonal, each half of the time, and cuts
    windows of a small grid. Disparities stay the same.
    """
    (row, col), disparities, image, around, high = made
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
    window = describe_window(rows, cols, disparities, planes)
    parts = (torch.from_numpy(part.copy()).to(image.device) for part in window)
    return Inputs(image.contiguous(), around.flatten(1, 2).contiguous(), *parts), high.contiguous()
