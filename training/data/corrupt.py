"""Corruption of low-resolution pictures as in cameras and files: blur, then noise, then JPEG."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image
from PIL.JpegImagePlugin import JpegImageFile
from scipy import ndimage

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Corruption:
    """Upper limits of corruption; each picture draws its own. Raises `ValueError` if one is out of range."""

    noise: float = 0.0
    """Largest standard deviation of Gaussian noise, in 8-bit levels, independent for each pixel and channel."""
    blur: float = 0.0
    """Largest standard deviation of a Gaussian blur, in pixels."""
    jpeg: int = 0
    """Lowest JPEG quality, 1 to 100 (libjpeg's scale, with chroma at half size as in most files); 0 for no JPEG."""

    def __post_init__(self) -> None:
        for name, value, most in (("noise", self.noise, 255.0), ("blur", self.blur, 20.0), ("jpeg", self.jpeg, 100)):
            if not 0 <= value <= most:
                raise ValueError(f"{name}: {value} is out of range; give 0 to {most:g}")

    def __bool__(self) -> bool:
        return bool(self.noise or self.blur or self.jpeg)

    @property
    def margin(self) -> int:
        """The number of pixels on each side of a crop that its blur depends on."""
        return _radius(self.blur)

    def __call__(
        self, picture: NDArray[np.uint8], rows: slice, cols: slice, random: np.random.Generator
    ) -> NDArray[np.uint8]:
        """Returns these rows and columns of `(H, W, 3)`, corrupted. The surrounding pixels contribute to the blur."""
        values = picture.astype(np.float64)
        if self.blur:
            values = blur_picture(values, random.uniform(0, self.blur))
        values = values[rows, cols]
        if self.noise:
            values += random.uniform(0, self.noise) * random.standard_normal(values.shape)
        corrupted = values.round().clip(0, 255).astype(np.uint8)
        return compress_jpeg(corrupted, int(random.integers(self.jpeg, 101))) if self.jpeg else corrupted


def blur_picture(picture: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Blurs `(H, W, C)` with a Gaussian of standard deviation `sigma` pixels, cut off at 3 sigma. It repeats edges."""
    blurred: NDArray[np.float64] = ndimage.gaussian_filter(
        picture, sigma, mode="nearest", radius=_radius(sigma), axes=(0, 1)
    )
    return blurred


def compress_jpeg(picture: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Encodes a picture with `encode_jpeg` and decodes it again."""
    with JpegImageFile(io.BytesIO(encode_jpeg(picture, quality))) as image:
        return np.array(image)


def encode_jpeg(picture: NDArray[np.uint8], quality: int) -> bytes:
    """Encodes 8-bit RGB `(H, W, 3)`, or grey `(H, W)`, as a JPEG of this quality, 1 to 100, with 4:2:0 chroma."""
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=quality, subsampling="4:2:0")
    return file.getvalue()


def _radius(sigma: float) -> int:
    return math.ceil(3 * sigma)
