"""The interface of a single-picture model: a function from pictures to larger pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from ciir.errors import BrokenNetwork, InvalidImage

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Upscaler(Protocol):
    """Upscales by an integer factor. Thread-safe.

    Sample centres line up as for area resampling: input sample i covers output samples `scale*i` to
    `scale*i + scale - 1`.
    """

    @property
    def name(self) -> str:
        """The model's name in the catalogue."""
        ...

    @property
    def scale(self) -> int:
        """The number of output pixels for each input pixel, along each side."""
        ...

    @property
    def radius(self) -> int:
        """The largest distance, in input pixels along each side, at which an input pixel can change an output pixel."""
        ...

    def __call__(self, images: NDArray[np.float32]) -> NDArray[np.float32]:
        """Upscales `(N, 3, H, W)` RGB in [0, 1] to `(N, 3, scale*H, scale*W)`, a new array clipped to [0, 1].

        N may be 0; H and W are at least 1. Raises `InvalidImage` if the input has another shape or type, is not
        finite, or is out of range, and `BrokenNetwork` if the output is not finite.
        """
        ...


def check_images(images: NDArray[np.float32]) -> None:
    """Raises `InvalidImage` unless `images` is `(N, 3, H, W)` float32 in [0, 1] with H and W of at least 1."""
    if images.dtype != np.float32:
        raise InvalidImage(f"pictures of type {images.dtype}: give float32 in [0, 1]")
    if images.ndim != 4 or images.shape[1] != 3 or 0 in images.shape[2:]:
        raise InvalidImage(f"an array of shape {images.shape}: give (N, 3, H, W) with H and W of at least 1")
    # A NaN makes both extremes NaN and so fails the comparison. Valid pictures cost two passes.
    if images.size == 0 or (images.min() >= 0.0 and images.max() <= 1.0):
        return
    bad = ~np.isfinite(images)
    if not bad.any():
        raise InvalidImage(f"values from {images.min()} to {images.max()}: scale the pictures to [0, 1]")
    index = tuple(int(i) for i in np.unravel_index(int(bad.argmax()), bad.shape))
    raise InvalidImage(
        f"{images[index]} at index {index} (picture, channel, row, column): give finite values in [0, 1]"
    )


def clip_output(output: NDArray[np.float32], name: str) -> NDArray[np.float32]:
    """Clips `output` to [0, 1] in place. Raises `BrokenNetwork` with `name` in the message if it is not finite."""
    if output.size and not (np.isfinite(output.min()) and np.isfinite(output.max())):
        raise BrokenNetwork(f"{name}: the network's output is not finite; reinstall it or choose another model")
    return np.clip(output, 0.0, 1.0, out=output)
