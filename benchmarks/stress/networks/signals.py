"""Runs every network on pictures, patterns and sinusoids: against the ONNX reference, and int8 against float."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import skip_without
from ciir.benchmarks.stress.networks import patterns, shipped
from ciir.benchmarks.stress.networks.shipped import LEVEL, UNSEEN, find_worst, peak, rms
from ciir.models.single.interpolation import Bicubic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort, Found, Skipped
    from ciir.benchmarks.stress.networks.shipped import Values

SIDE = 32
STEPS = 16
"""All frequencies of a picture of 32x32, from 0 to Nyquist."""
REFERENCE_STEPS = 3
"""Steps for the reference, which takes a quarter of a second for a picture."""
INT8_ROUNDING = 3.0
"""Levels RMS that int8 in onnxruntime may differ from int8 in the reference. If float rounding differs at a half, the
code is its neighbour, and later layers pass the step on; in a periodic pattern this happens everywhere at the same
time. Steps of the last grids are under one level."""
INT8_RMS = 2.0
"""Levels RMS that int8 may be away from float on pictures. The export stops at 0.08 dB lost on average over its views
(`training.export.quantise.LIMIT`): for a float network with 33 dB, that is 0.8 levels. The bound is 0.5 dB of 33."""
INT8_WORST = 32.0
"""Levels that the worst pixel of pictures may be off: an eighth of the range, seen as one odd pixel next to an edge."""
INT8_FURTHER = 2.55
"""Levels RMS, a hundredth of the range, by which int8 may be further from bicubic interpolation than float is, whatever
the input. Grids are made for pictures, and values outside are cut. So a pattern gets a smaller correction, which is
added to an exact base: int8 falls back to interpolation."""
SCALE_OUTSIDE = 10.0
"""Rounding errors are relative: values ten times as large may differ by ten times as much."""


def make_inputs(steps: int) -> dict[str, Values]:
    """Makes pictures, patterns and sinusoids of one size."""
    waves = patterns.make_sinusoids(SIDE, steps)
    return {**patterns.make_pictures(SIDE), **patterns.make_patterns(SIDE, SIDE), **waves}


@skip_without("onnx", "onnxruntime against the reference on patterns")
def against_reference(effort: Effort) -> Iterator[Found | Skipped]:
    """Compares onnxruntime with the ONNX reference on pictures, patterns and sinusoids."""
    inputs = make_inputs(1 if effort.quick else REFERENCE_STEPS)
    names, images = list(inputs), np.stack(list(inputs.values()))
    for name in effort.models:
        difference = shipped.load_network(name)(images) - shipped.load_reference(name)(images)
        what = "onnxruntime against the reference"
        yield shipped.bound_difference(what, name, difference, names, int8_rms=INT8_ROUNDING)


@skip_without("onnx", "onnxruntime against the reference outside [0, 1]")
def outside_the_range(effort: Effort) -> Iterator[Found | Skipped]:
    """Compares onnxruntime with the ONNX reference for values up to +-10, which only the graph itself accepts."""
    inputs = patterns.make_outside(SIDE, SIDE)
    images = np.stack(list(inputs.values()))
    for name in shipped.list_float_networks(effort):
        difference = peak(shipped.load_network(name)(images) - shipped.load_reference(name)(images))
        what = f"{name}: onnxruntime against the reference up to +-10, worst value"
        yield find_worst(what, SCALE_OUTSIDE * UNSEEN, difference, list(inputs))


def against_float(effort: Effort) -> Iterator[Found]:
    """Compares int8 with float on pictures, patterns and sinusoids of all frequencies."""
    inputs = make_inputs(2 if effort.quick else STEPS)
    names, images = list(inputs), np.stack(list(inputs.values()))
    count = len(patterns.make_pictures(SIDE))  # they come first
    base = Bicubic(2)(images)
    for name, twin in shipped.list_int8_twins(effort):
        exact, coarse = (np.clip(shipped.load_network(each)(images), 0, 1) for each in (name, twin))
        difference = (coarse - exact)[:count] / LEVEL
        yield find_worst(f"{twin}: against {name} on pictures, RMS, levels", INT8_RMS, rms(difference), names)
        yield find_worst(
            f"{twin}: against {name} on pictures, worst pixel, levels", INT8_WORST, peak(difference), names
        )
        further = (rms(coarse - base) - rms(exact - base)) / LEVEL
        what = f"{twin}: further from bicubic than {name}, any input, RMS, levels"
        yield find_worst(what, INT8_FURTHER, further, names)


CASES: tuple[Case, ...] = (against_reference, outside_the_range, against_float)
