"""Training crops of degraded photographs and rendered views, mixed by the shares of a recipe."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from ciir.training.data import downscale, labels
from ciir.training.data.corrupt import Corruption
from ciir.training.data.pictures import MEMORY, Pictures
from ciir.training.data.stack import ORIENTATIONS, PairStack, Places, orient

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

CPU = torch.device("cpu")
LABELLED = "labelled"
"""Bicubic LR, with a stronger network's output for it as the truth: see `labels`."""
RENDERED = ("pinhole", "lenslet")
"""Views of random scenes and of meshes by each kind of array: see `rendered` and `mesh_views`."""
BICUBIC_VIEW = "bicubic-view"
"""The truth of rendered views, downscaled like a photograph, so that drawings are not treated as views of a lens
array."""


@dataclass(frozen=True)
class Photograph:
    """A picture from a folder, degraded on demand."""

    among: Pictures
    index: int
    kind: str
    scale: int

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of LR."""
        covered = downscale.cell_size(self.kind, self.scale)
        height, width = self.among.sizes[self.index]
        return height // covered, width // covered

    @property
    def pair(self) -> downscale.Pair:
        """The whole degraded picture and its HR."""
        return downscale.downscale_picture(self.kind, self.among[self.index], self.scale)

    def crop(self, rows: slice, cols: slice) -> downscale.Pair:
        """Returns these LR rows and columns and their HR, with the same pixels as in the whole degraded picture."""
        return downscale.downscale_crop(self.kind, self.among[self.index], self.scale, rows, cols)


class Rendered:
    """A view and its truth, kept in memory."""

    def __init__(self, pair: downscale.Pair) -> None:
        self.pair = pair

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of LR."""
        return self.pair.low.shape[0], self.pair.low.shape[1]

    def crop(self, rows: slice, cols: slice) -> downscale.Pair:
        """Returns these LR rows and columns, and their HR."""
        return downscale.crop_pair(self.pair, len(self.pair.high) // len(self.pair.low), rows, cols)


Pair = Photograph | Rendered


class Crops:
    """Random aligned LR and HR crops with flips and rotations, from 8-bit pictures.

    The batch of step `s` depends only on the seed and `s`. LR is cropped on the sample grid from whole pictures that
    are degraded by the published protocol. Blur, noise and JPEG (`training.data.corrupt`) then act on LR only.
    """

    def __init__(
        self,
        folder: Path,
        *,
        crop: int,
        scale: int,
        batch: int,
        seed: int,
        degradations: Mapping[str, float] = MappingProxyType({"bicubic": 1.0}),
        scenes: int = 0,
        meshes: Sequence[str | Path] = (),
        labelled: Path | None = None,
        noise: float = 0.0,
        blur: float = 0.0,
        jpeg: int = 0,
        corrupted: float = 1.0,
        memory: int = MEMORY,
        device: torch.device = CPU,
    ) -> None:
        """`folder`: see `training.data.pictures.find_pictures`; pictures smaller than the crop are skipped.

        `crop`: HR side in pixels, a multiple of `scale`. `degradations`: kind -> weight. Kinds are those of
        `training.data.downscale.KINDS`; with `scenes`, a number of random scenes, or `meshes`, files, also `RENDERED`
        and `BICUBIC_VIEW`; and with `labelled`, a folder (`training.data.labels`), also `LABELLED`. `noise`, `blur`,
        `jpeg`, `corrupted`: see `training.recipe`. `memory`: bytes of decoded pictures that are kept, which affects
        only the speed. `device`: the device on which batches are made. The crops are the same on all of them. A GPU
        cuts them from its own copy of all pairs, except corrupted LR, which the CPU makes.

        Raises `ValueError` if one of these or the folder is wrong.
        """
        known: tuple[str, ...] = downscale.KINDS
        if scenes or meshes:
            known = (*known, *RENDERED, BICUBIC_VIEW)
        if labelled is not None:
            known = (*known, LABELLED)
        check_degradations(crop, scale, degradations, known)
        if labelled is not None:
            check_labelled(degradations, scale)
        self.crop, self.scale, self.batch, self.seed = crop, scale, batch, seed
        self.corruption, self.corrupted = Corruption(noise, blur, jpeg), corrupted
        photographs = Pictures(folder, memory=memory)
        pairs: dict[str, Sequence[Pair]] = {
            kind: [Photograph(photographs, index, kind, scale) for index in range(len(photographs))]
            for kind in downscale.KINDS
            if kind in degradations
        }
        if scenes or meshes:
            seen = list(_render_pairs(photographs, scenes, meshes, scale=scale, crop=crop, seed=seed))
            pairs |= {kind: [Rendered(of[i]) for of in seen] for i, kind in enumerate(RENDERED)}
            if BICUBIC_VIEW in degradations:
                pairs[BICUBIC_VIEW] = [
                    Rendered(downscale.downscale_picture("bicubic", truth, scale)) for (_, truth), _ in seen
                ]
        if labelled is not None:
            pairs[LABELLED] = [Rendered(pair) for pair in labels.read_labelled(labelled)]
        self.groups = [_drop_small(folder, kind, pairs[kind], crop, scale) for kind in degradations]
        weights = np.array(list(degradations.values()), float)
        self.shares = weights / weights.sum()
        self._pairs = [pair for group in self.groups for pair in group]
        self._sizes = np.array([pair.size for pair in self._pairs])
        self._counts = np.array([len(group) for group in self.groups])
        self._starts = np.cumsum(self._counts) - self._counts
        self._stack = None if device.type == "cpu" else self._stack_pairs(device)

    def _stack_pairs(self, device: torch.device) -> PairStack:
        side, pairs = self.crop // self.scale, self._pairs
        return PairStack(self._sizes, lambda index: pairs[index].pair, side=side, scale=self.scale, device=device)

    def make_batch(self, step: int) -> tuple[Tensor, Tensor]:
        """Makes LR `(batch, 3, crop/scale, crop/scale)` and HR `(batch, 3, crop, crop)` on `device`, in [0, 1]."""
        places = self._draw_places(step)
        corrupted = self._corrupt_crops(places, step)
        if self._stack is not None:
            low, high = self._stack.cut(places)
            for index, pair in corrupted.items():
                low[index] = torch.from_numpy(orient(pair.low, places.orientation[index]).copy())
        else:
            crops = [
                corrupted.get(index) or self._cut(*place)
                for index, place in enumerate(zip(places.pair, places.y, places.x, strict=True))
            ]
            low, high = (
                torch.from_numpy(np.stack([orient(*each) for each in zip(part, places.orientation, strict=True)]))
                for part in zip(*crops, strict=True)
            )
        low, high = (part.permute(0, 3, 1, 2).float().div(255.0) for part in (low, high))
        return low, high

    def _draw_places(self, step: int) -> Places:
        random = np.random.default_rng((self.seed, step))
        group = random.choice(len(self.groups), self.batch, p=self.shares)
        pair = self._starts[group] + random.integers(self._counts[group])
        y, x = random.integers(self._sizes[pair] - self.crop // self.scale + 1).T
        return Places(pair, y, x, random.integers(ORIENTATIONS, size=self.batch))

    def _cut(self, pair: int, y: int, x: int) -> downscale.Pair:
        """Returns the crop whose first LR sample is `(y, x)`."""
        side = self.crop // self.scale
        return self._pairs[pair].crop(slice(y, y + side), slice(x, x + side))

    def _corrupt_crops(self, places: Places, step: int) -> dict[int, downscale.Pair]:
        """Returns the crops of a batch whose LR is corrupted, by their index in the batch."""
        random = np.random.default_rng((self.seed, step, 1))  # separate, so that corruption does not change the crops
        chosen = np.flatnonzero(random.random(self.batch) < self.corrupted).tolist() if self.corruption else []
        return {
            index: self._corrupt_crop(self._pairs[places.pair[index]], places.y[index], places.x[index], random)
            for index in chosen
        }

    def _corrupt_crop(self, pair: Pair, y: int, x: int, random: np.random.Generator) -> downscale.Pair:
        """Returns the crop whose first LR sample is `(y, x)`, with LR corrupted."""
        side, margin = self.crop // self.scale, self.corruption.margin
        top, left = max(0, y - margin), max(0, x - margin)
        rows, cols = slice(y - top, y - top + side), slice(x - left, x - left + side)
        around = (slice(top, min(pair.size[0], y + side + margin)), slice(left, min(pair.size[1], x + side + margin)))
        whole = pair.crop(*around)
        high = downscale.crop_pair(whole, self.scale, rows, cols).high
        return downscale.Pair(self.corruption(whole.low, rows, cols, random), high)


def check_degradations(crop: int, scale: int, degradations: Mapping[str, float], known: Sequence[str]) -> None:
    """Raises `ValueError` for impossible arguments. `known`: the kinds that there is data for."""
    rendered = set(RENDERED) <= set(known)
    if crop < scale or crop % scale:
        raise ValueError(f"a crop of {crop} pixels is not a multiple of the scale {scale}")
    for kind, share in degradations.items():
        if kind not in known:
            raise ValueError(
                f"degradations: no {kind!r} here; give {', '.join(known)}"
                + ("" if rendered else f"; {', '.join(RENDERED)} need scenes or meshes")
            )
        if not isinstance(share, (int, float)) or isinstance(share, bool) or not 0 < share < math.inf:
            raise ValueError(f"degradations: the share of {kind} is {share!r}; give a number above 0")
    if not degradations:
        raise ValueError(f"degradations: none given; give shares of {', '.join(known)}")
    if rendered and not {*RENDERED, BICUBIC_VIEW} & set(degradations):
        raise ValueError(f"degradations: scenes and meshes are of no use without {' or '.join(RENDERED)}; add a share")


def check_labelled(degradations: Mapping[str, float], scale: int) -> None:
    """Raises `ValueError` if labelled pairs have no share, or their scale is not `scale`."""
    if LABELLED not in degradations:
        raise ValueError(f"degradations: labelled pictures are of no use without {LABELLED}; add a share")
    if scale != labels.SCALE:
        raise ValueError(
            f"scale is {scale}, but labelled pictures are {labels.SCALE} times as large as their LR; give that scale, "
            "or no labelled pictures"
        )


def _render_pairs(
    photographs: Pictures, scenes: int, meshes: Sequence[str | Path], *, scale: int, crop: int, seed: int
) -> Iterator[tuple[downscale.Pair, downscale.Pair]]:
    """Renders random scenes, with photographs as textures, and meshes for a pinhole and a lenslet array."""
    from ciir.training.data import mesh_views, rendered

    if crop > scale * rendered.SIDE:
        raise ValueError(f"scenes and meshes are rendered for crops up to {scale * rendered.SIDE} pixels, not {crop}")
    models = [mesh_views.read_mesh(path) for path in meshes]
    tqdm.write(f"rendering {scenes} scenes and {len(models)} meshes: minutes for hundreds", file=sys.stderr)
    seen = rendered.render_scenes(photographs, scenes, seed=seed, scale=scale)
    yield from tqdm(seen, total=scenes, disable=None, desc="rendering", unit="scene")
    for number, model in enumerate(tqdm(models, disable=None, desc="rendering", unit="mesh")):
        for index in range(mesh_views.PICTURES):
            yield mesh_views.render_pairs(model, seed=seed, index=number * mesh_views.PICTURES + index, scale=scale)


def _drop_small(folder: Path, kind: str, pairs: Sequence[Pair], crop: int, scale: int) -> list[Pair]:
    large = [pair for pair in pairs if min(pair.size) * scale >= crop]
    what = f"smaller than the crop of {crop}x{crop} pixels ({kind})"
    if not large:
        raise ValueError(f"{folder}: every picture is {what}; set a smaller crop")
    if len(large) < len(pairs):
        left_out = f"{len(pairs) - len(large)} of {len(pairs)} pictures are skipped: they are {what}"
        tqdm.write(f"{folder}: {left_out}", file=sys.stderr)
    return large
