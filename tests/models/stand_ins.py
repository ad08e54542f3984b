"""Stand-ins for networks: convolutions of integers with a known receptive field and zeros around the picture, so that
results are equal or not. Each layer ends in a remainder, so that an output pixel depends on everything that it sees.
"""

from itertools import pairwise

import numpy as np

PRIME = 65521


class Layers:
    """3x3 convolutions with random integer weights, each followed by a remainder."""

    def __init__(self, channels, seed):
        random = np.random.default_rng(seed)
        self.kernels = [random.integers(1, 1000, (after, before, 3, 3)) for before, after in pairwise(channels)]

    def __call__(self, planes):
        for kernel in self.kernels:
            padded = np.pad(planes, ((0, 0), (0, 0), (1, 1), (1, 1)))
            planes = np.full((len(planes), len(kernel), *planes.shape[2:]), 77)
            for row in range(3):
                for col in range(3):
                    part = padded[:, :, row : row + planes.shape[2], col : col + planes.shape[3]]
                    planes += np.einsum("ncyx,oc->noyx", part, kernel[:, :, row, col])
            planes %= PRIME
        return planes


def to_integers(values):
    return np.rint(values.astype(np.float64) * 65535).astype(np.int64)


def shuffle_pixels(planes):
    """`(N, 12, H, W)` -> `(N, 3, 2*H, 2*W)` in [0, 1]."""
    count, _, height, width = planes.shape
    spread = planes.reshape(count, 3, 2, 2, height, width).transpose(0, 1, 4, 2, 5, 3)
    return (spread.reshape(count, 3, 2 * height, 2 * width) % 256 / 255).astype(np.float32)


class IntegerNetwork:
    """A single-picture network with a receptive field of `layers` pixels; `radius`: what it reports instead."""

    name, scale = "integer", 2

    def __init__(self, layers=3, radius=None):
        self.radius = layers if radius is None else radius
        self.layers = Layers([3, *[4] * (layers - 1), 12], seed=layers)
        self.pixels = 0

    def __call__(self, images):
        self.pixels += len(images) * images.shape[2] * images.shape[3]
        return shuffle_pixels(self.layers(to_integers(images)))


class IntegerLightFieldNetwork:
    """The same as a light-field network, whose result depends on the range of disparities too; `is_confident`: whether
    its uncertainty stays below `CONFIDENT`.
    """

    scale, threads, runs = 2, 1, 1

    def __init__(self, layers=3, radius=None, *, is_confident=False):
        self.radius = layers if radius is None else radius
        self.layers = Layers([28, *[4] * (layers - 1), 13], seed=layers)
        self.pixels, self.most = 0, 0.5 if is_confident else 1.0

    def __call__(self, image, around, rows, cols, disparities, *, cores=None):
        self.pixels += len(image) * image.shape[2] * image.shape[3]
        weights = 1 + np.arange(25) * np.outer(rows.present, cols.present).ravel()
        weights += disparities.highest - 2 * disparities.lowest
        inputs = [to_integers(image), to_integers(around * weights[:, None, None])]
        planes = self.layers(np.concatenate(inputs, axis=1))
        return shuffle_pixels(planes[:, :12]), (planes[:, 12:] % 256 / 255 * self.most).astype(np.float32)
