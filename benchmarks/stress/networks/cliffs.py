"""PSNR against brightness, contrast, gamma and noise: a network may gain less, but not fall off a cliff."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found
from ciir.benchmarks.stress.networks import patterns
from ciir.benchmarks.stress.networks.shipped import LEVEL, downsample
from ciir.models import catalogue, upscale_pixels
from ciir.training.evaluation.metrics import compute_psnr, rgb_to_luma

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from ciir.benchmarks.stress.case import Case, Effort
    from ciir.benchmarks.stress.networks.shipped import Values

SIDE = 128
"""Side of the truth, in pixels."""
GOOD_ENOUGH = 48.0
"""dB: an error of one level RMS. Above it no error is visible, and only int8's steps are left."""
BELOW_BICUBIC = 1.0
"""How many dB a network may be below bicubic interpolation on pictures of any brightness, contrast or gamma."""
BELOW_ON_NOISE = 8.0
"""How many dB a network may be below bicubic interpolation on noise. Bicubic halves noise (0.8 of its amplitude) and a
network sharpens it, by `gain.NOISE` at most: a factor of 2.5, 8 dB. Networks were trained on clean pictures."""
JUMP = 2.0
"""How many dB the margin over bicubic may change from one step to the next. Steps are small: a fifth of an octave of
contrast, brightness or gamma, or a third more noise."""


def brightness(effort: Effort) -> Iterator[Found]:
    """Multiplies all levels by 1/16 to 1."""
    yield from _follow_margin(
        effort, "brightness", _octaves(effort, -4, 0), lambda image, factor: np.float32(factor) * image
    )


def contrast(effort: Effort) -> Iterator[Found]:
    """Draws all levels towards grey, to 1/16 to 1 of their distance, or pushes them away from it, up to twice, and
    clips them.
    """

    def change(image: Values, factor: float) -> Values:
        return np.asarray(np.clip(0.5 + (image - 0.5) * np.float32(factor), 0, 1))

    yield from _follow_margin(effort, "contrast", _octaves(effort, -4, 1), change)


def gamma(effort: Effort) -> Iterator[Found]:
    """Raises all levels to the power of 1/4 to 4."""
    yield from _follow_margin(effort, "gamma", _octaves(effort, -2, 2), lambda image, power: image ** np.float32(power))


def noise(effort: Effort) -> Iterator[Found]:
    """Adds white Gaussian noise of 0 to 32 levels to the networks' input."""
    steps = [0.0, *(0.5 * 2 ** (step / 2.5) for step in range(0, 16, 5 if effort.quick else 1))]
    yield from _follow_margin(effort, "noise", steps, None)


def _octaves(effort: Effort, first: int, last: int) -> list[float]:
    count = (last - first) * (1 if effort.quick else 5)
    return [float(step) for step in np.logspace(first, last, count + 1, base=2)]


def _follow_margin(
    effort: Effort, what: str, steps: list[float], change: Callable[[Values, float], Values] | None
) -> Iterator[Found]:
    """Measures the margin over bicubic at each of `steps`, which are noise in levels if there is no `change` to the
    truth.
    """
    truths = np.stack(list(patterns.render_views(SIDE).values()))
    series = {name: np.zeros(len(steps)) for name in (*effort.models, "")}
    for index, step in enumerate(steps):
        truth = truths if change is None else change(truths, step)
        low = downsample(truth)
        if change is None:
            random = np.random.default_rng(0)
            low = low + np.float32(step * LEVEL) * random.standard_normal(low.shape, dtype=np.float32)
        for name, scores in series.items():
            scores[index] = _score(
                upscale_pixels(catalogue.load_upscaler(name or "bicubic"), _pixels(low)), _pixels(truth)
            )
    bicubic = series.pop("")
    floor, wide = (BELOW_ON_NOISE if change is None else BELOW_BICUBIC), JUMP * (3 if effort.quick else 1)
    for name, scores in series.items():
        below = np.minimum(bicubic, GOOD_ENOUGH) - np.minimum(scores, GOOD_ENOUGH)
        at = int(np.argmax(below))
        where = f"{what} {steps[at]:.3g}: {scores[at]:.2f} dB, bicubic {bicubic[at]:.2f}"
        yield Found(f"{name}: dB below bicubic at any {what}", floor, float(below[at]), where)
        jumps = np.abs(np.diff(below))
        at = int(np.argmax(jumps))
        where = f"{what} {steps[at]:.3g} to {steps[at + 1]:.3g}"
        yield Found(f"{name}: dB from step to step of {what}", wide, float(jumps[at]), where)


def _pixels(images: Values) -> NDArray[np.uint8]:
    """Converts `(N, 3, H, W)` in about [0, 1] to `(N, H, W, 3)` of 8 bits."""
    return np.moveaxis(np.rint(255 * np.clip(images, 0, 1)).astype(np.uint8), 1, 3)


def _score(pictures: NDArray[np.uint8], truths: NDArray[np.uint8]) -> float:
    """Returns the mean Y-PSNR in dB; a picture that comes out exactly counts as 60."""
    pairs = ((rgb_to_luma(picture), rgb_to_luma(truth)) for picture, truth in zip(pictures, truths, strict=True))
    return float(np.mean([min(60.0, compute_psnr(*pair, border=2)) for pair in pairs]))


CASES: tuple[Case, ...] = (brightness, contrast, gamma, noise)
