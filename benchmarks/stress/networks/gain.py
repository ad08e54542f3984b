"""Measures how much a network amplifies small errors in its input: noise, and the worst error.

The gain is the RMS of the output's change divided by the RMS of the input's. Nearest has 1; bicubic has 0.8 for white
noise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.networks import patterns, shipped
from ciir.benchmarks.stress.networks.shipped import LEVEL, find_worst, rms

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort, Found

SIDE = 48
NOISE = 2.0
"""Sharpening amplifies what is near Nyquist, where white noise is as strong as anywhere; a gain of 2 costs one bit."""
NOISE_KNOWN = {"gan": 3.0}
"""Networks that are known to need more: an adversary rewards texture, and almost invisible noise is the seed of it."""
SMALL, QUICK_SMALL = 12, 8
"""Side of the picture whose whole Jacobian is computed: 432 inputs, or 192."""
STEP = 1e-3
"""Step of the differences: a quarter of a level, within which most ReLUs stay on their side; rounding is 1e-4 of it."""
WORST = 32.0
"""Gain in the worst direction: five bits, ten times the gain on noise and more, because one pattern of few pixels gets
all the energy. An adversary who controls the rounding to 8 bits, 0.29 levels RMS, then moves the output by 9 levels
RMS."""


def noise(effort: Effort) -> Iterator[Found]:
    """Adds white Gaussian noise of 1/4 to 16 levels to pictures, and measures the output's change per unit of it."""
    inputs = patterns.make_pictures(SIDE)
    # Away from black and white, so that the noise is not clipped.
    images = 0.25 + 0.5 * np.stack(list(inputs.values()))
    random = np.random.default_rng(0)
    white = random.standard_normal(images.shape, dtype=np.float32)
    for name in effort.models:
        run = shipped.load_network(name)
        clean, found = run(images), dict[str, float]()
        for levels in (1, 4) if effort.quick else (0.25, 0.5, 1, 2, 4, 8, 16):
            error = white * np.float32(levels * LEVEL)
            gain = rms(run(images + error) - clean) / rms(error)
            found |= {f"{levels} levels on {key}": value for key, value in zip(inputs, gain, strict=True)}
        if shipped.is_int8(name):  # an input below a step of its grids rounds to zero or to a whole step
            found = {key: value for key, value in found.items() if not key.startswith("0.")}
        bound, gains = NOISE_KNOWN.get(name, NOISE), np.array(list(found.values()))
        yield find_worst(f"{name}: gain on noise", bound, gains, list(found))


def worst_direction(effort: Effort) -> Iterator[Found]:
    """Measures the largest gain of any small error, from the singular values of the whole Jacobian by finite
    differences.
    """
    side = QUICK_SMALL if effort.quick else SMALL
    inputs = patterns.make_pictures(side)
    for name in shipped.list_float_networks(effort):
        run, found = shipped.load_network(name), dict[str, float]()
        for key, image in inputs.items():
            middle = 0.25 + 0.5 * image
            directions = np.eye(middle.size, dtype=np.float32).reshape(-1, *middle.shape) * np.float32(STEP)
            jacobian = (run(middle + directions) - run(middle - directions)).reshape(middle.size, -1) / (2 * STEP)
            largest = float(np.linalg.svd(jacobian.astype(np.float64), compute_uv=False)[0])
            found[key] = largest * np.sqrt(middle.size / jacobian.shape[1])
        what = f"{name}: gain in the worst direction, {side}x{side}"
        yield find_worst(what, WORST, np.array(list(found.values())), list(found))


CASES: tuple[Case, ...] = (noise, worst_direction)
