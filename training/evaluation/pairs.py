"""Scores of views, or of pictures, against true ones of the same number and size."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.bit_depth import BITS, count_unused_camera_bits, limit_levels
from ciir.training.data.light_field.views import convert_views
from ciir.training.evaluation.metrics import SSIM_RADIUS, compute_psnr, compute_ssim, convert_to_luma

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray


def check_sizes(result: str, made: Sequence[int], truth: str, wanted: Sequence[int], *, border: int) -> None:
    """Checks that views of the shapes `made` and `wanted`, `(V, U, H, W, C)`, can be compared inside `border` pixels.

    Raises `ValueError`, with the names `result` and `truth`, if they differ in number, size or channels, or are too
    small for SSIM.
    """
    if made != wanted:
        # LR pixels, each `border` = scale wide, leave rows and columns of the truth over
        missing = [true - own for own, true in zip(made[2:4], wanted[2:4], strict=True)]
        is_cut = any(missing) and all(0 <= count < border for count in missing)
        such = f", such as the upper left {made[2]}x{made[3]} pixels of the truth" if is_cut else ""
        raise ValueError(
            f"{result}: {_describe(made)}, but {truth} has {_describe(wanted)}; give views of the same number and size"
            f"{such}"
        )
    if min(wanted[2:4]) - 2 * border <= 2 * SSIM_RADIUS:
        raise ValueError(f"{truth}: {_describe(wanted)}; SSIM needs more than {2 * (SSIM_RADIUS + border)} each way")


def score_view(made: NDArray[Any], wanted: NDArray[Any], white: White, *, border: int) -> tuple[float, float]:
    """Returns Y-PSNR (dB) and SSIM of a view `(H, W, C)` of 8 or 16 bits, without a border of `border` pixels."""
    white.count(made, wanted)
    got, best = white.make_luma(made), white.make_luma(wanted)
    return compute_psnr(got, best, border=border), compute_ssim(got, best, border=border)


class White:
    """The white level of 16-bit results: that of their truth, whatever levels they have themselves.

    It is the largest level of the bits that a camera of such pictures has (`ciir.bit_depth.count_unused_camera_bits`).
    """

    def __init__(self, wanted: Iterable[NDArray[Any]]) -> None:
        """Takes all views or pictures of the truth, of 8 or 16 bits."""
        counts = [count_unused_camera_bits(views) for views in wanted if views.dtype == np.uint16]
        self.unused = min(counts, default=0)
        """How many bits of 16 the truth doesn't use."""
        self._over = 0
        self._dark: list[int] = []

    def make_luma(self, view: NDArray[Any]) -> NDArray[np.float64]:
        """Returns Y `(H, W)` of a view `(H, W, C)`, grey or RGB, after rounding to 8 bits. Levels above white become
        white.
        """
        if view.dtype == np.uint16 and self.unused:
            view = limit_levels(view.copy(), self.unused)
        return convert_to_luma(convert_views(view[None, None], keeps_grey=True, unused=self.unused)[0, 0])

    def count(self, made: NDArray[Any], wanted: NDArray[Any]) -> None:
        """Keeps what `describe` says about views that are compared."""
        if made.dtype == np.uint16:
            self._over += int((made > self._level).sum())
            if wanted.dtype == np.uint8 and not self.unused:
                self._dark.append(count_unused_camera_bits(made))

    def describe(self, result: str, truth: str) -> tuple[str, ...]:
        """Returns a note if white isn't the largest level of 16 bits, or the result may need another one."""
        over = f"; samples of {result} above it, which count as white: {self._over:,}" if self._over else ""
        if self.unused:
            return (f"white is level {self._level:,}, because {truth} uses {BITS - self.unused} of 16 bits{over}",)
        if dark := min(self._dark, default=0):
            used = f"{result} uses {BITS - dark} of 16 bits, but {truth} has 8 bits"
            return (f"{used}, so white is level {self._level:,}; scale its levels up if it is too dark",)
        return ()

    @property
    def _level(self) -> int:
        return int(2 ** (BITS - self.unused)) - 1


def _describe(shape: Sequence[int]) -> str:
    rows, cols, height, width, channels = shape
    of_what = f"{rows}x{cols} views of " if (rows, cols) != (1, 1) else ""
    return f"{of_what}{height}x{width} pixels, {'grey' if channels == 1 else f'{channels} channels'}"
