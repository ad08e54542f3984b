"""Networks that upscale one picture at a time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ciir.models import tiles
from ciir.models.parallel import is_parallel_faster
from ciir.models.sessions import BATCH_PIXELS, TILE_PIXELS, OnnxNetwork
from ciir.models.upscaler import check_images, clip_output

if TYPE_CHECKING:
    from numpy.typing import NDArray


class SingleImageNetwork(OnnxNetwork):
    """A network as an `Upscaler`."""

    def __call__(self, images: NDArray[np.float32]) -> NDArray[np.float32]:
        """See `Upscaler.__call__`. Large pictures run in tiles, small ones in batches.

        An int8 network runs them in parallel, each on one core: its layers are so short that cores which share them
        wait a sixth of the time. Float networks would gain at most a fifteenth, and take several times the memory.
        """
        check_images(images)
        sizes = self.card.sizes
        padded, kept = tiles.pad_pictures(images, *sizes.round_up(*images.shape[2:]), scale=self.scale)
        result = tiles.run_in_tiles(
            self._run,
            padded,
            scale=self.scale,
            radius=self.radius,
            tile_pixels=TILE_PIXELS,
            batch_pixels=BATCH_PIXELS,
            multiple=sizes.multiple_of,
            cores=self.threads,
            at_once=self._runs_in_parallel,
        )
        return clip_output(np.ascontiguousarray(result[:, :, *kept]), self.name)

    def count_cores(self, pixels: int) -> int:
        """Returns on how many cores each tile of one picture of `pixels` pixels runs."""
        tiles_at_least = math.ceil(pixels / TILE_PIXELS)
        return 1 if self._runs_in_parallel and is_parallel_faster(tiles_at_least, self.threads) else self.threads

    @property
    def _runs_in_parallel(self) -> bool:
        return self.card.precision == "int8"

    def _run(self, images: NDArray[np.float32], cores: int) -> NDArray[np.float32]:
        name = self.card.input.name
        if self.card.input.shape[0] == 1:  # an external network that takes one picture at a time
            return np.concatenate([self.run({name: image[None]}, cores)[0] for image in images])
        return self.run({name: images}, cores)[0]
