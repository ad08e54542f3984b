"""Light-field networks: they upscale a view with the help of the window of views around it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidImage
from ciir.models import tiles
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.models.sessions import OnnxNetwork
from ciir.models.upscaler import check_images, clip_output

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""ITU-R BT.601's weights of red, green and blue: networks use only the luma of the views around."""
FLIPS = ((), (2, 3), (2,), (3,))
"""Axes of pictures `(N, C, H, W)` that are reversed, for each of the orientations of `models.cards.Card.flips`: the
geometric self-ensemble of EDSR (Lim et al., CVPRW 2017) without its transposes."""


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
        """Upscales `image`, views as RGB in [0, 1], `(N, 3, H, W)`.

        `around`: the luma of their windows, row by row, `(N, 25, H, W)`. `rows` and `cols`: which rows and columns of
        those windows are present (`models.light_field.windows.Axis.present`). `cores`: see `OnnxNetwork.run`.

        Returns `(N, 3, scale*H, scale*W)`, a new array clipped to [0, 1], and the uncertainty, `(N, 1, H, W)`,
        nominally in [0, 1]: how badly the views around match the view. All goes in one run;
        `models.light_field.views` cuts large views into tiles.

        Raises as `Upscaler.__call__`.
        """
        check_images(image)
        _check_around(image, around)
        size = self.card.sizes.round_up(*image.shape[2:])
        image, kept = tiles.pad_pictures(image, *size, scale=self.scale)
        around, _ = tiles.pad_pictures(around, *size, scale=self.scale)
        inputs = {"image": image, "around": around, "rows": rows, "cols": cols}
        made = [self._run_flipped(inputs, axes, cores) for axes in FLIPS[: self.card.flips]]
        large, uncertainty = (_average(parts) for parts in zip(*made, strict=True))
        small = tuple(slice(side.start // self.scale, side.stop // self.scale) for side in kept)
        return clip_output(np.ascontiguousarray(large[:, :, *kept]), self.name), uncertainty[:, :, *small]

    def _run_flipped(
        self, inputs: Mapping[str, NDArray[np.float32]], axes: tuple[int, ...], cores: int | None
    ) -> list[NDArray[np.float32]]:
        """The outputs for `inputs` whose pictures are reversed along `axes`, of 2 and 3, and their windows along rows
        and columns with them; the outputs are put back."""
        if not axes:
            return self.run(inputs, cores)
        around, rows, cols = inputs["around"], inputs["rows"], inputs["cols"]
        by_row, by_col = (_order(there, is_reversed=axis in axes) for there, axis in ((rows, 2), (cols, 3)))
        window = around.reshape(-1, WINDOW_SIDE, WINDOW_SIDE, *around.shape[2:])[:, by_row][:, :, by_col]
        flipped = {
            "image": np.ascontiguousarray(np.flip(inputs["image"], axes)),
            "around": np.ascontiguousarray(np.flip(window.reshape(around.shape), axes)),
            "rows": rows[by_row],
            "cols": cols[by_col],
        }
        return [np.flip(output, axes) for output in self.run(flipped, cores)]


def _order(there: NDArray[np.float32], *, is_reversed: bool) -> NDArray[np.intp]:
    """The rows or columns of a window in order, or those that are `there` reversed: absent ones stay last."""
    order = np.arange(len(there))
    count = np.count_nonzero(there)
    return np.concatenate([order[:count][::-1], order[count:]]) if is_reversed else order


def _average(parts: tuple[NDArray[np.float32], ...]) -> NDArray[np.float32]:
    """The mean of arrays of one shape."""
    return parts[0] if len(parts) == 1 else sum(parts[1:], parts[0]) / np.float32(len(parts))


def compute_luma(picture: NDArray[np.uint8 | np.uint16], peak: float) -> NDArray[np.float32]:
    """Luma of `(H, W, C)` in [0, peak], grey or RGB -> `(H, W)` in [0, 1] up to rounding.

    It is summed by channel, so that rounding is the same at every pixel; a matrix product would sum in an order that
    depends on the position.
    """
    if picture.shape[-1] == 1:
        return np.asarray(picture[..., 0] * np.float32(1 / peak))
    weights = LUMA / np.float32(peak)
    luma: NDArray[np.float32] = picture[..., 0] * weights[0]
    luma += picture[..., 1] * weights[1]
    luma += picture[..., 2] * weights[2]
    return luma


def _check_around(image: NDArray[np.float32], around: NDArray[np.float32]) -> None:
    shape = (len(image), WINDOW_SIDE * WINDOW_SIDE, *image.shape[2:])
    if around.dtype != np.float32 or around.shape != shape:
        raise InvalidImage(f"views around of {around.dtype} and shape {around.shape}: give float32 of {shape}")
    if around.size and not (around.min() >= 0.0 and around.max() <= 1.0):  # a NaN fails too
        raise InvalidImage("views around: values that are not finite or out of range; give them in [0, 1]")
