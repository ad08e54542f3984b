"""Light-field networks, which upscale a view with the help of the window of views around it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidImage
from ciir.models import tiles
from ciir.models.light_field.planes import describe_window, stagger
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.models.sessions import OnnxNetwork
from ciir.models.upscaler import check_images, clip_output

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.models.light_field.planes import Range, Window
    from ciir.models.light_field.windows import Axis

LUMA = (0.299, 0.587, 0.114)
"""ITU-R BT.601's weights of red, green and blue. Networks use only the luma of the neighbouring views."""


class LightFieldNetwork(OnnxNetwork):
    """A shipped light-field network; see `training.networks.light_field` for what it computes."""

    @property
    def runs(self) -> int:
        """How many runs its results are means of, 1 or 2."""
        return self.card.runs

    def __call__(
        self,
        image: NDArray[np.float32],
        around: NDArray[np.float32],
        rows: Axis,
        cols: Axis,
        disparities: Range,
        *,
        cores: int | None = None,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Upscales `image`: views as RGB in [0, 1], `(N, 3, H, W)`.

        `around`: the luma of their windows, row by row, `(N, 25, H, W)`. `rows` and `cols`: the rows and columns of
        those windows. `disparities`: the range of the scene's disparities (`models.light_field.disparities.ranges`), LR
        pixels from one view to the next; content beyond it is upscaled without the neighbouring views. `cores`: see
        `OnnxNetwork.run`.

        Returns `(N, 3, scale*H, scale*W)`, a new array clipped to [0, 1], and the uncertainty, `(N, 1, H, W)`, at least
        0. It measures how badly the neighbouring views match the view, and is 1 or more where they don't. Everything is
        computed at once; `models.light_field.views` cuts large views into tiles.

        If `runs` is 2, both are means of two: in the second, everything is mirrored (geometric
        self-ensemble: Lim et al., "Enhanced deep residual networks", CVPRW 2017), and its planes lie between those of
        the first.

        Raises the same errors as `Upscaler.__call__`.
        """
        check_images(image)
        _check_around(image, around)
        planes = self.card.planes
        if self.runs == 1:
            return self._run_once(image, around, describe_window(rows, cols, disparities, planes), cores)
        first, second = stagger(disparities, planes)
        mirrored_cols, places = cols.mirror()
        window = around.reshape(len(image), WINDOW_SIDE, WINDOW_SIDE, *image.shape[2:])
        mirrored = image[..., ::-1], window[:, :, places, :, ::-1].reshape(around.shape)
        results = self._run_once(image, around, describe_window(rows, cols, first, planes), cores)
        others = self._run_once(*mirrored, describe_window(rows, mirrored_cols, second, planes), cores)
        large, uncertainty = (
            (one + other[..., ::-1]) * np.float32(0.5) for one, other in zip(results, others, strict=True)
        )
        return large, uncertainty

    def _run_once(
        self, image: NDArray[np.float32], around: NDArray[np.float32], window: Window, cores: int | None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        size = self.card.sizes.round_up(*image.shape[2:])
        image, kept = tiles.pad_pictures(image, *size, scale=self.scale)
        around, _ = tiles.pad_pictures(around, *size, scale=self.scale)
        window = window.trim()
        inputs = {"image": image, "around": around, "down": window.down, "across": window.across}
        large, uncertainty = self.run(inputs | {"window": window.description}, cores)
        small = tuple(slice(side.start // self.scale, side.stop // self.scale) for side in kept)
        return clip_output(np.ascontiguousarray(large[:, :, *kept]), self.name), uncertainty[:, :, *small]


def compute_luma(picture: NDArray[np.uint8 | np.uint16], peak: float) -> NDArray[np.float32]:
    """Computes the luma of `(H, W, C)` in [0, peak], grey or RGB: `(H, W)` in [0, 1] up to rounding.

    Channels are added one after the other, so that rounding is the same at every pixel. A matrix product would sum in
    an order that depends on the position.
    """
    if picture.shape[-1] == 1:
        return np.asarray(picture[..., 0] * np.float32(1 / peak))
    weights = np.array(LUMA, np.float32) / np.float32(peak)
    luma: NDArray[np.float32] = picture[..., 0] * weights[0]
    luma += picture[..., 1] * weights[1]
    luma += picture[..., 2] * weights[2]
    return luma


def _check_around(image: NDArray[np.float32], around: NDArray[np.float32]) -> None:
    shape = (len(image), WINDOW_SIDE * WINDOW_SIDE, *image.shape[2:])
    if around.dtype != np.float32 or around.shape != shape:
        raise InvalidImage(f"neighbouring views of {around.dtype} and shape {around.shape}: give float32 of {shape}")
    if around.size and not (around.min() >= 0.0 and around.max() <= 1.0):  # a NaN fails too
        raise InvalidImage("neighbouring views: some values are not finite or out of range; give them in [0, 1]")
