"""Stand-ins for networks: convolutions of known reach, zeros around the picture, and whole numbers, so that results are
equal or aren't. Each layer ends in a remainder: whatever an output pixel sees shows in it.
"""

from itertools import pairwise

import numpy as np

PRIME = 65521


class Layers:
    """3x3 convolutions of random whole weights, each followed by a remainder."""

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


def whole(values):
    return np.rint(values.astype(np.float64) * 65535).astype(np.int64)


def shuffled(planes):
    """`(N, 12, H, W)` -> `(N, 3, 2*H, 2*W)` in [0, 1]."""
    count, _, height, width = planes.shape
    spread = planes.reshape(count, 3, 2, 2, height, width).transpose(0, 1, 4, 2, 5, 3)
    return (spread.reshape(count, 3, 2 * height, 2 * width) % 256 / 255).astype(np.float32)


class Mixing:
    """A single-picture network that sees `layers` pixels far; `radius`: what it says of that."""

    name, scale = "mixing", 2

    def __init__(self, layers=3, radius=None):
        self.radius = layers if radius is None else radius
        self.layers = Layers([3, *[4] * (layers - 1), 12], seed=layers)
        self.seen = 0

    def __call__(self, images):
        self.seen += len(images) * images.shape[2] * images.shape[3]
        return shuffled(self.layers(whole(images)))


class MixingViews:
    """The same as a light-field network; `doubtful`: whether its doubt goes beyond what is trusted."""

    scale, threads = 2, 1

    def __init__(self, layers=3, radius=None, *, doubtful=True):
        self.radius = layers if radius is None else radius
        self.layers = Layers([28, *[4] * (layers - 1), 13], seed=layers)
        self.seen, self.most = 0, 1.0 if doubtful else 0.5

    def __call__(self, image, around, rows, cols, *, cores=None):
        self.seen += len(image) * image.shape[2] * image.shape[3]
        weights = 1 + np.arange(25) * np.outer(rows, cols).ravel()
        planes = self.layers(np.concatenate([whole(image), whole(around * weights[:, None, None])], axis=1))
        return shuffled(planes[:, :12]), (planes[:, 12:] % 256 / 255 * self.most).astype(np.float32)
