"""Light-field networks on the CPU: one view upscaled with the help of the window of views around it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidImage
from ciir.models import tiles
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.models.sessions import OnnxNetwork
from ciir.models.upscaler import check_images, clip_output

if TYPE_CHECKING:
    from numpy.typing import NDArray

LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""ITU-R BT.601's weights of red, green and blue: what is looked at of the views around."""


class LightFieldNetwork(OnnxNetwork):
    """A shipped light-field network; see `training.networks.light_field` for what it computes."""

    def __call__(
        self,
        image: NDArray[np.float32],
        around: NDArray[np.float32],
        rows: NDArray[np.float32],
        cols: NDArray[np.float32],
        *,
        cores: int | None = None,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """`image`: views as RGB in [0, 1], `(N, 3, H, W)`; `around`: the luma of the windows about them, row by row,
        `(N, 25, H, W)`; `rows` and `cols`: what is there of all those windows
        (`models.light_field.windows.Axis.present`).

        Returns `(N, 3, scale*H, scale*W)`, a new array clipped to [0, 1]; and the doubt, `(N, 1, H, W)`, nominally in
        [0, 1]: how little the views around have to do with the view. All goes in one run: `models.light_field.views`
        cuts large
        views into tiles. `cores`: see `OnnxNetwork.run`.

        Raises as `Upscaler.__call__`.
        """
        check_images(image)
        _check_around(image, around)
        size = self.card.sizes.fitted(*image.shape[2:])
        image, kept = tiles.padded(image, *size, scale=self.scale)
        around, _ = tiles.padded(around, *size, scale=self.scale)
        large, doubt = self.run({"image": image, "around": around, "rows": rows, "cols": cols}, cores)
        small = tuple(slice(side.start // self.scale, side.stop // self.scale) for side in kept)
        return clip_output(np.ascontiguousarray(large[:, :, *kept]), self.name), doubt[:, :, *small]


def luma(picture: NDArray[np.float32 | np.uint8 | np.uint16], peak: float) -> NDArray[np.float32]:
    """`(H, W, C)` in [0, peak], grey or RGB -> `(H, W)` in [0, 1], but for rounding, which is the same at every place:
    a product of matrices adds up in an order that depends on it.
    """
    if picture.shape[-1] == 1:
        return np.asarray(picture[..., 0] * np.float32(1 / peak))
    weights = LUMA / np.float32(peak)
    made: NDArray[np.float32] = picture[..., 0] * weights[0]
    made += picture[..., 1] * weights[1]
    made += picture[..., 2] * weights[2]
    return made


def _check_around(image: NDArray[np.float32], around: NDArray[np.float32]) -> None:
    wanted = (len(image), WINDOW_SIDE * WINDOW_SIDE, *image.shape[2:])
    if around.dtype != np.float32 or around.shape != wanted:
        raise InvalidImage(f"views around of {around.dtype} and shape {around.shape}: give float32 of {wanted}")
    if around.size and not (around.min() >= 0.0 and around.max() <= 1.0):  # a NaN fails too
        raise InvalidImage("views around: values that are not finite or out of range; give them in [0, 1]")
