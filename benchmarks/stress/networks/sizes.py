"""Every network on pictures of every size and shape: against torch, and int8 against float."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.benchmarks.stress.networks import in_torch, shipped
from ciir.benchmarks.stress.networks import patterns as made
from ciir.benchmarks.stress.networks.shipped import LEVEL, UNSEEN, peak, rms, worst
from ciir.benchmarks.stress.networks.signals import INT8_WORST, ROUNDED_AWAY
from ciir.models import catalogue

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort
    from ciir.benchmarks.stress.networks.shipped import Values

LARGEST = 40
QUICK = ((1, 1), (1, 2), (2, 1), (1, 40), (40, 1), (5, 7), (8, 8), (13, 31), (40, 40))
EXTREMES = ((1, 4096), (4096, 1), (2, 3000), (3000, 3))
FLAT = 4.0
"""Levels that a flat grey picture may come out of its grey, whatever its size. Networks pad with zeros and must learn
to see past them; where they have not, white gets a darker frame."""
FLAT_KNOWN = {"paper": 8.0}
"""The paper's network does have that frame on white. It ships for comparison, as published."""


def sizes(effort: Effort) -> tuple[tuple[int, int], ...]:
    """(height, width) of every size to be tried."""
    sides = range(1, LARGEST + 1)
    return QUICK if effort.quick else tuple((height, width) for height in sides for width in sides)


def crop(height: int, width: int) -> Values:
    """`(1, 3, height, width)` out of the middle of a natural picture, so that a small one is as smooth as a large."""
    tall, wide = max(64, height), max(64, width)
    picture = made.natural(tall, wide)
    top, left = (tall - height) // 2, (wide - width) // 2
    return np.ascontiguousarray(picture[None, :, top : top + height, left : left + width])


def against_torch(effort: Effort) -> Iterator[Found | Skipped]:
    """onnxruntime against torch at every size from 1x1 to 40x40, and 1x4096."""
    if missing := in_torch.missing():
        yield Skipped("onnxruntime against torch at every size", missing)
        return
    tried = {f"{height}x{width}": crop(height, width) for height, width in (*sizes(effort), *_extremes(effort))}
    for name in effort.models:
        ours, theirs = shipped.raw(name), shipped.torch_twin(name)
        differences = [ours(image) - theirs(image) for image in tried.values()]
        what = f"{name}: onnxruntime against torch at every size"
        if shipped.is_int8(name):
            levels = np.concatenate([rms(difference) / LEVEL for difference in differences])
            measured, where = worst(levels, list(tried))
            yield Found(f"{what}, RMS, levels", ROUNDED_AWAY, measured, where)
        else:
            measured, where = worst(np.concatenate([peak(difference) for difference in differences]), list(tried))
            yield Found(f"{what}, worst value", UNSEEN, measured, where)


def against_float(effort: Effort) -> Iterator[Found]:
    """int8 against float at every size from 1x1 to 40x40, and 1x4096."""
    tried = {f"{height}x{width}": crop(height, width) for height, width in (*sizes(effort), *_extremes(effort))}
    for name, twin in shipped.twins(effort):
        large, coarse = catalogue.load_upscaler(name), catalogue.load_upscaler(twin)
        levels = [peak(coarse(image) - large(image)) / LEVEL for image in tried.values()]
        measured, where = worst(np.concatenate(levels), list(tried))
        yield Found(f"{twin}: against {name} at every size, worst pixel, levels", INT8_WORST, measured, where)


def flat(effort: Effort) -> Iterator[Found]:
    """A flat picture of every size comes out flat, and twice as large."""
    for name in effort.models:
        model = catalogue.load_upscaler(name)
        tried = [(size, grey) for size in sizes(effort) for grey in (0.0, 0.5, 1.0)]
        away, wrong = [], []
        for (height, width), grey in tried:
            result = model(np.full((1, 3, height, width), grey, np.float32))
            if result.shape != (1, 3, height * model.scale, width * model.scale):
                wrong.append(f"{height}x{width}")
            away.append(peak(result - np.float32(grey)) / LEVEL)
        yield Found(f"{name}: sizes whose result has another size than twice theirs", 0, len(wrong), ", ".join(wrong))
        names = [f"{height}x{width} of {grey}" for (height, width), grey in tried]
        measured, where = worst(np.concatenate(away), names)
        yield Found(
            f"{name}: a flat picture of any size, worst pixel, levels", FLAT_KNOWN.get(name, FLAT), measured, where
        )


def in_tiles(effort: Effort) -> Iterator[Found]:
    """Pictures that are split into tiles, 70x1100 and 1x70000: as the graph alone computes them whole."""
    shapes = ((70, 1100),) if effort.quick else ((70, 1100), (1100, 70), (1, 70000), (70000, 1), (300, 300))
    for name in shipped.floats(effort):
        model, whole, away = catalogue.load_upscaler(name), shipped.raw(name), []
        least = shipped.card(name).sizes.minimum
        for height, width in shapes:
            image = crop(height, width)
            rows, cols = (max(0, least - side) for side in (height, width))
            around = ((0, 0), (0, 0), (rows // 2, rows - rows // 2), (cols // 2, cols - cols // 2))
            large = np.clip(whole(np.pad(image, around, mode="edge")), 0, 1)
            top, left = rows // 2 * model.scale, cols // 2 * model.scale
            kept = large[:, :, top : top + height * model.scale, left : left + width * model.scale]
            away.append(peak(model(image) - kept))
        measured, where = worst(np.concatenate(away), [f"{height}x{width}" for height, width in shapes])
        yield Found(f"{name}: in tiles against whole, worst value", UNSEEN, measured, where)


def batches(effort: Effort) -> Iterator[Found]:
    """Batches of none, one and many: each picture as alone, to the bit."""
    counts = (0, 1, 2, 9) if effort.quick else (0, 1, 2, 3, 9, 33, 100)
    for name in effort.models:
        model, wrong = catalogue.load_upscaler(name), []
        pictures = np.concatenate([made.natural(16, 21, seed=seed)[None] for seed in range(max(counts))])
        alone = np.concatenate([model(picture[None]) for picture in pictures])
        wrong = [str(count) for count in counts if not np.array_equal(model(pictures[:count]), alone[:count])]
        yield Found(f"{name}: batches that differ from pictures alone", 0, len(wrong), ", ".join(wrong))


def _extremes(effort: Effort) -> tuple[tuple[int, int], ...]:
    return EXTREMES[:2] if effort.quick else EXTREMES


CASES: tuple[Case, ...] = (against_torch, against_float, flat, in_tiles, batches)
