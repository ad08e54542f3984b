"""What a network makes of small errors in its input: of noise, and of the worst error there is.

The gain is the RMS of the output's change over the RMS of the input's. Nearest has 1; bicubic 0.8 for white noise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.benchmarks.stress.networks import in_torch, shipped
from ciir.benchmarks.stress.networks import patterns as made
from ciir.benchmarks.stress.networks.shipped import LEVEL, rms, worst

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort

SIDE = 48
NOISE = 2.0
"""Sharpening amplifies what is near Nyquist, where white noise is as strong as anywhere; by 2 it costs one bit."""
NOISE_KNOWN = {"gan": 3.0}
"""An adversary rewards texture, and noise that is all but invisible is the seed of it."""
SMALL, QUICK_SMALL = 12, 8
"""Side of the picture whose Jacobian is worked out whole: 432 inputs, or 192."""
STEP = 1e-3
"""Of the differences: a quarter of a level, within which most ReLUs stay on their side; rounding is 1e-4 of it."""
WORST = 32.0
"""Gain in the worst direction: five bits, ten times the gain on noise and more, as one pattern of few pixels gets all
the energy. An adversary who owns the rounding to 8 bits, 0.29 levels RMS, then moves the output by 9 levels RMS."""
SEARCH_SIDE = 24
SEARCH_RMS = 0.5 / 255
"""The input error that the search may spend."""
SEARCH_STEPS = 40


def noise(effort: Effort) -> Iterator[Found]:
    """White Gaussian noise of 1/4 to 16 levels on pictures: the output's change for each unit of it."""
    given = made.pictures(SIDE)
    # Away from black and white, so that the noise is not cut.
    images = 0.25 + 0.5 * np.stack(list(given.values()))
    random = np.random.default_rng(0)
    white = random.standard_normal(images.shape, dtype=np.float32)
    for name in effort.models:
        run = shipped.raw(name)
        clean, found = run(images), dict[str, float]()
        for levels in (1, 4) if effort.quick else (0.25, 0.5, 1, 2, 4, 8, 16):
            error = white * np.float32(levels * LEVEL)
            gain = rms(run(images + error) - clean) / rms(error)
            found |= {f"{levels} levels on {key}": value for key, value in zip(given, gain, strict=True)}
        if shipped.is_int8(name):  # below a step of its grids it sees nothing, or a whole step
            found = {key: value for key, value in found.items() if not key.startswith("0.")}
        measured, where = worst(np.array(list(found.values())), list(found))
        yield Found(f"{name}: gain on noise", NOISE_KNOWN.get(name, NOISE), measured, where)


def worst_direction(effort: Effort) -> Iterator[Found]:
    """The largest gain of any small error, from the singular values of the whole Jacobian by finite differences."""
    side = QUICK_SMALL if effort.quick else SMALL
    given = made.pictures(side)
    for name in shipped.floats(effort):
        run, found = shipped.raw(name), dict[str, float]()
        for key, image in given.items():
            middle = 0.25 + 0.5 * image
            directions = np.eye(middle.size, dtype=np.float32).reshape(-1, *middle.shape) * np.float32(STEP)
            jacobian = (run(middle + directions) - run(middle - directions)).reshape(middle.size, -1) / (2 * STEP)
            largest = float(np.linalg.svd(jacobian.astype(np.float64), compute_uv=False)[0])
            found[key] = largest * np.sqrt(middle.size / jacobian.shape[1])
        measured, where = worst(np.array(list(found.values())), list(found))
        yield Found(f"{name}: gain in the worst direction, {side}x{side}", WORST, measured, where)


def gradient_search(effort: Effort) -> Iterator[Found | Skipped]:
    """The worst error of half a level RMS that a gradient search finds, over the picture and the error together."""
    if missing := in_torch.missing():
        yield Skipped("worst amplification by gradient search", missing)
        return
    import torch

    start = torch.from_numpy(0.25 + 0.5 * np.stack(list(made.pictures(SEARCH_SIDE).values())))
    generator = torch.Generator().manual_seed(0)
    for name in shipped.floats(effort):
        network = in_torch.network(shipped.weights(name))
        images = start.clone()
        error = torch.randn(images.shape, generator=generator)
        highest = torch.zeros(len(images))
        for _ in range(8 if effort.quick else SEARCH_STEPS):
            error = (error * (SEARCH_RMS / error.square().mean(dim=(1, 2, 3), keepdim=True).sqrt())).requires_grad_()
            images.requires_grad_()
            change = (network(images + error) - network(images)).square().mean(dim=(1, 2, 3)).sqrt()
            highest = torch.maximum(highest, change.detach() / SEARCH_RMS)
            by_error, by_image = torch.autograd.grad(change.sum(), (error, images))
            with torch.no_grad():
                error = by_error  # scaled at the top: the power method, were the network linear
                images = (images + 0.02 * by_image.sign()).clamp(0, 1)
        measured, where = worst(highest.numpy(), list(made.pictures(SEARCH_SIDE)))
        yield Found(f"{name}: gain of the worst error that a search finds", WORST, measured, f"from {where}")


CASES: tuple[Case, ...] = (noise, worst_direction, gradient_search)
