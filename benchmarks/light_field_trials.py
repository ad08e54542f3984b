"""Ways to look at the views around one, trained alike for a short while: which gains most at equal time?

    python -m benchmarks.light_field_trials --train runs/pictures --validate ../shared/data/lightfields/knights

All have about the multiply-adds of `field` for one view, start from random weights, and see the same crops. What is
printed: Y-PSNR of the middle view of the folder, made small in each way, after the same number of updates.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional
from tqdm import tqdm

from training import degrade, recipe, view_validation
from training.field import Inputs
from training.networks import NETWORKS
from training.networks.collapsible import CollapsibleConv, collapse
from training.networks.compact import CompactGenerator
from training.networks.interpolation import Bicubic
from training.networks.light_field import LightFieldGenerator
from training.run import Run
from training.view_crops import ViewCrops

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

UPDATES = 600
NEAR = (6, 7, 8, 11, 12, 13, 16, 17, 18)
CROSS = (2, 7, 10, 11, 12, 13, 14, 17, 22)
OWN = 12


class Stack(nn.Module):
    """The luma of chosen views, less the view's own, beside its colours: one picture of many channels."""

    def __init__(self, views: Sequence[int], width: int, depth: int) -> None:
        super().__init__()
        self.views, self.scale = list(views), 2
        self.head = nn.Conv2d(len(self.views) + 3, width, kernel_size=5, padding=2)
        self.body = nn.Sequential()
        for _ in range(depth):
            self.body.extend([nn.ReLU(), CollapsibleConv(width, width, gain=0.5)])
        self.tail = nn.Sequential(nn.ReLU(), CollapsibleConv(width, 12, gain=0.1))
        self.base = Bicubic(2)

    def forward(self, image: Tensor, around: Tensor, rows: Tensor, cols: Tensor) -> Tensor:  # noqa: ARG002 - alike
        """See `training.networks.light_field.LightFieldGenerator`."""
        differences = 2 * (around[:, self.views] - around[:, OWN : OWN + 1])
        change = self.tail(self.body(self.head(torch.cat([image, differences], 1))))
        return functional.pixel_shuffle(change.float() + self.base(image), 2)


class SpatialAngular(nn.Module):
    """Convolutions over pixels and over views in turn (LFSSR, Yeung et al., IEEE TIP 2019), then one view."""

    def __init__(self, width: int, depth: int, fused: int) -> None:
        super().__init__()
        self.scale = 2
        self.head = nn.Conv2d(1, width, kernel_size=3, padding=1)
        self.spatial = nn.ModuleList(nn.Conv2d(width, width, kernel_size=3, padding=1) for _ in range(depth))
        self.angular = nn.ModuleList(nn.Conv2d(width, width, kernel_size=3, padding=1) for _ in range(depth))
        self.fuse = CollapsibleConv(25 * width + 3, fused)
        self.body = nn.Sequential(nn.ReLU(), CollapsibleConv(fused, fused, gain=0.5), nn.ReLU())
        self.tail = CollapsibleConv(fused, 12, gain=0.1)
        self.base = Bicubic(2)

    def forward(self, image: Tensor, around: Tensor, rows: Tensor, cols: Tensor) -> Tensor:  # noqa: ARG002 - alike
        """See `training.networks.light_field.LightFieldGenerator`."""
        count, views, height, width = around.shape
        x = self.head(around.reshape(count * views, 1, height, width))
        channels = x.shape[1]
        for spatial, angular in zip(self.spatial, self.angular, strict=True):
            x = x + functional.relu(spatial(x))
            grid = x.reshape(count, 5, 5, channels, height, width).permute(0, 4, 5, 3, 1, 2)
            grid = functional.relu(angular(grid.reshape(-1, channels, 5, 5)))
            grid = grid.reshape(count, height, width, channels, 5, 5).permute(0, 4, 5, 3, 1, 2)
            x = x + grid.reshape(count * views, channels, height, width)
        x = torch.cat([x.reshape(count, views * channels, height, width), image], 1)
        change = self.tail(self.body(self.fuse(x)))
        return functional.pixel_shuffle(change.float() + self.base(image), 2)


class Alone(CompactGenerator):
    """The view alone: what the others must beat."""

    def forward(self, image: Tensor, around: Tensor, rows: Tensor, cols: Tensor) -> Tensor:  # type: ignore[override]  # noqa: ARG002
        """See `training.networks.light_field.LightFieldGenerator`."""
        return super().forward(image)


TRIALS: dict[str, Callable[[], nn.Module]] = {
    "one view": lambda: Alone((48,) * 11, slope=0.0),
    "3x3 views stacked": lambda: Stack(NEAR, 48, 9),
    "cross of 9 views stacked": lambda: Stack(CROSS, 48, 9),
    "5x5 views stacked": lambda: Stack(range(25), 48, 8),
    "spatial-angular, 5x5": lambda: SpatialAngular(10, 3, 40),
    "plane sweep, 9 planes": lambda: LightFieldGenerator(planes=9),
    "plane sweep (field)": LightFieldGenerator,
}


def macs(network: nn.Module, inputs: Inputs) -> float:
    """Multiply-adds for each pixel of the view, thousands."""
    from torch.utils.flop_counter import FlopCounterMode

    with FlopCounterMode(display=False) as counter, torch.no_grad():
        collapse(network)(*inputs)
    return float(counter.get_total_flops() / 2e3 / inputs.image[:, 0].numel())


def halved(batch: tuple[Inputs, Tensor]) -> tuple[Inputs, Tensor]:
    """In 16 bits, so that all trials can see the same batches out of memory."""
    inputs, high = batch
    return Inputs(*(part.half() for part in inputs)), high.half()


def main(argv: list[str] | None = None) -> int:
    """Trains each of `TRIALS` and prints a line for it."""
    parser = argparse.ArgumentParser(prog="benchmarks.light_field_trials", description=main.__doc__)
    parser.add_argument("--train", type=Path, required=True, help="pictures for the textures of scenes")
    parser.add_argument("--validate", type=Path, required=True, help="views of a light field")
    parser.add_argument("--updates", type=int, default=UPDATES)
    given = parser.parse_args(argv)
    template = replace(
        recipe.read(Path(__file__).parents[1] / "training" / "recipes" / "field-first.toml"),
        train=str(given.train),
        initial="",
        meshes=[],
        degradations={"point": 0.35, "box": 0.2, "bicubic": 0.45},
        steps=given.updates,
        warmup=100,
        ema=0.99,
    )
    crops = ViewCrops(
        given.train,
        crop=template.crop,
        scale=2,
        batch=template.batch,
        seed=3,
        degradations=template.degradations,
        eased=4 * given.updates,
    )
    batches = [
        halved(crops.at(step)) for step in tqdm(range(given.updates), disable=None, desc="scenes", unit="update")
    ]
    fields = view_validation.fields(given.validate, 2)
    say = sys.stdout.write
    say(f"{'':28s}{'k MACs':>8s}{'s/update':>10s}" + "".join(f"{kind:>9s}" for kind in degrade.KINDS) + "\n")
    for name, make in TRIALS.items():
        NETWORKS[name] = make
        run = Run(replace(template, network=name, options={}))
        spent = 0.0
        for stored in batches:
            inputs, high = Inputs(*(part.float() for part in stored[0])), stored[1].float()
            begun = time.perf_counter()
            run.update(inputs, high)
            spent += time.perf_counter() - begun
        scores = [view_validation.validate(run.average, [field]) for field in fields]
        cost = macs(run.network.cpu(), Inputs(*(part.float() for part in batches[0][0])))
        say(f"{name:28s}{cost:8.0f}{spent / given.updates:10.3f}" + "".join(f"{s:9.2f}" for s in scores) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
