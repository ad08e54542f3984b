"""Runs every network on pictures of every size and shape: against the ONNX reference, and int8 against float."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found, skip_without
from ciir.benchmarks.stress.networks import patterns, shipped
from ciir.benchmarks.stress.networks.shipped import LEVEL, find_worst, peak
from ciir.benchmarks.stress.networks.signals import INT8_ROUNDING, INT8_WORST
from ciir.models import catalogue

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort, Skipped
    from ciir.benchmarks.stress.networks.shipped import Values

LARGEST = 40
QUICK = ((1, 1), (1, 2), (2, 1), (1, 40), (40, 1), (5, 7), (8, 8), (13, 31), (1, 4096), (4096, 1))
EXTREMES = ((1, 4096), (4096, 1), (2, 3000), (3000, 3))
FLAT = 4.0
"""Levels by which a flat picture may change, whatever its size. Networks pad with zeros and learn to compensate for it;
if they have not, white gets a darker frame."""
FLAT_KNOWN = {"paper": 8.0}
"""The paper's network has that frame on white. It ships for comparison, as published."""


def list_sizes(effort: Effort) -> tuple[tuple[int, int], ...]:
    """Returns (height, width) of every size to be tried."""
    sides = range(1, LARGEST + 1)
    return QUICK if effort.quick else (*((height, width) for height in sides for width in sides), *EXTREMES)


def crop_picture(height: int, width: int) -> Values:
    """Returns `(1, 3, height, width)` from the middle of a natural picture, so that a small one is as smooth as a large
    one.
    """
    tall, wide = max(64, height), max(64, width)
    picture = patterns.make_natural(tall, wide)
    top, left = (tall - height) // 2, (wide - width) // 2
    return np.ascontiguousarray(picture[None, :, top : top + height, left : left + width])


@skip_without("onnx", "onnxruntime against the reference at every size")
def against_reference(effort: Effort) -> Iterator[Found | Skipped]:
    """Compares onnxruntime with the ONNX reference at heights 1, 2, 3, 5, ..., 34 and every width from 1 to 40."""
    heights = (1, 2, 3, 5, 8, 13, 21, 34)  # the reference is too slow for all
    sizes = [size for size in list_sizes(effort) if size[0] in heights]
    for name in effort.models:
        network, reference = shipped.load_network(name), shipped.load_reference(name)
        found = []
        for height, width in sizes:
            image = crop_picture(height, width)
            difference = network(image) - reference(image)
            what = "onnxruntime against the reference at every size"
            where = [f"{height}x{width}"]
            found.append(shipped.bound_difference(what, name, difference, where, int8_rms=INT8_ROUNDING))
        yield max(found, key=lambda one: np.nan_to_num(one.measured, nan=np.inf))


def against_float(effort: Effort) -> Iterator[Found]:
    """Compares int8 with float at every size from 1x1 to 40x40, and 1x4096."""
    tried = {f"{height}x{width}": crop_picture(height, width) for height, width in list_sizes(effort)}
    for name, twin in shipped.list_int8_twins(effort):
        exact, coarse = catalogue.load_upscaler(name), catalogue.load_upscaler(twin)
        levels = np.concatenate([peak(coarse(image) - exact(image)) / LEVEL for image in tried.values()])
        what = f"{twin}: against {name} at every size, worst pixel, levels"
        yield find_worst(what, INT8_WORST, levels, list(tried))


def flat(effort: Effort) -> Iterator[Found]:
    """Checks that a flat picture of every size comes out flat, and twice as large."""
    tried = [(size, grey) for size in list_sizes(effort) for grey in (0.0, 0.5, 1.0)]
    names = [f"{height}x{width} of {grey}" for (height, width), grey in tried]
    for name in effort.models:
        model = catalogue.load_upscaler(name)
        changes, wrong = [], []
        for (height, width), grey in tried:
            result = model(np.full((1, 3, height, width), grey, np.float32))
            if result.shape != (1, 3, height * model.scale, width * model.scale):
                wrong.append(f"{height}x{width}")
            changes.append(peak(result - np.float32(grey)) / LEVEL)
        yield Found(f"{name}: sizes whose result has another size than twice theirs", 0, len(wrong), ", ".join(wrong))
        what = f"{name}: a flat picture of any size, worst pixel, levels"
        yield find_worst(what, FLAT_KNOWN.get(name, FLAT), np.concatenate(changes), names)


CASES: tuple[Case, ...] = (against_reference, against_float, flat)
