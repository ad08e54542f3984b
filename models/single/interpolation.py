"""The baselines: interpolation with the interface of a network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import UnsupportedScale
from ciir.models.upscaler import check_images

if TYPE_CHECKING:
    from numpy.typing import NDArray

SCALES = range(2, 9)
"""The factors that interpolation upscales by."""
KEYS_A = -0.5
"""Keys' parameter a, as in MATLAB's `imresize`."""


def keys_kernel(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns Keys' cubic convolution kernel (IEEE Trans. ASSP 29(6), 1981, equation 4) at distances `x` in samples."""
    a, d = KEYS_A, np.abs(x)
    near = (a + 2) * d**3 - (a + 3) * d**2 + 1
    far = a * (d**3 - 5 * d**2 + 8 * d - 4)
    return np.where(d <= 1, near, np.where(d < 2, far, 0.0))


def _check_scale(name: str, scale: int) -> None:
    if scale not in SCALES:
        raise UnsupportedScale(f"scale: {name} can't upscale by {scale}; give {SCALES[0]} to {SCALES[-1]}")


@dataclass(frozen=True)
class Bicubic:
    """Cubic convolution in float; the picture's edge pixels are repeated beyond its border.

    Output sample `scale*i + p` lies at `i + (p + 1/2)/scale - 1/2` in input samples (`align_corners=False`).
    """

    scale: int
    name: str = "bicubic"
    radius: int = 2

    def __post_init__(self) -> None:
        _check_scale(self.name, self.scale)

    def __call__(self, images: NDArray[np.float32]) -> NDArray[np.float32]:
        """See `Upscaler.__call__`."""
        check_images(images)
        return np.clip(self._upscale_axis(self._upscale_axis(images, 2), 3), 0.0, 1.0)

    def _upscale_axis(self, images: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
        """Upscales `images` along one axis, without clipping."""
        length = images.shape[axis]
        shape = list(images.shape)
        shape[axis] *= self.scale
        result = np.zeros(shape, np.float32)
        padding = [(0, 0)] * 4
        padding[axis] = (self.radius, self.radius)
        padded = np.pad(images, padding, mode="edge")
        taps = range(-self.radius, self.radius + 1)
        for phase in range(self.scale):
            every = [slice(None)] * 4
            every[axis] = slice(phase, None, self.scale)
            offset = (phase + 0.5) / self.scale - 0.5
            for tap, weight in zip(taps, keys_kernel(np.array(taps) - offset).astype(np.float32), strict=True):
                if weight:
                    window = [slice(None)] * 4
                    window[axis] = slice(tap + self.radius, tap + self.radius + length)
                    result[tuple(every)] += weight * padded[tuple(window)]
        return result


@dataclass(frozen=True)
class Nearest:
    """Nearest-neighbour interpolation: each pixel repeated."""

    scale: int
    name: str = "nearest"
    radius: int = 0

    def __post_init__(self) -> None:
        _check_scale(self.name, self.scale)

    def __call__(self, images: NDArray[np.float32]) -> NDArray[np.float32]:
        """See `Upscaler.__call__`."""
        check_images(images)
        return images.repeat(self.scale, axis=2).repeat(self.scale, axis=3)
