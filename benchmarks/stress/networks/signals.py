"""Every network on pictures, patterns and what is no picture: against torch, and int8 against float."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.benchmarks.stress.networks import in_torch, shipped
from ciir.benchmarks.stress.networks import patterns as made
from ciir.benchmarks.stress.networks.shipped import LEVEL, UNSEEN, peak, rms, worst
from ciir.errors import InvalidImage
from ciir.models import catalogue
from ciir.models.single.interpolation import Bicubic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort
    from ciir.benchmarks.stress.networks.shipped import Values

SIDE = 32
STEPS = 16
"""Of a picture of 32x32, frequencies from 0 to Nyquist in 16 steps are all that there are."""
ROUNDED_AWAY = 3.0
"""Levels RMS that int8 in onnxruntime may differ from int8 in torch. Where float rounding falls on the other side of a
half, a code is the next one, and layers behind pass the step on; a periodic pattern has it everywhere at once. Steps of
the last grids are under one level; on pictures next to no code differs."""
INT8_RMS = 2.0
"""Levels RMS that int8 may be away from float on pictures. The export stops at 0.08 dB lost on average over its views
(`training.export.quantise.LIMIT`): of a float network with 33 dB, that is 0.8 levels. This is room for a picture of
another
kind: 0.5 dB of 33."""
INT8_WORST = 32.0
"""Levels, of the worst pixel of pictures: an eighth of the range, seen as one odd pixel beside an edge."""
INT8_FURTHER = 2.55
"""Levels RMS, a hundredth of the range, by which int8 may be further from bicubic interpolation than float is, whatever
the input. Grids are made for pictures; what leaves them is cut, so a pattern gets a smaller correction, which is added
to an exact base: int8 falls back to interpolation and makes nothing up."""
SCALE_OUTSIDE = 10.0
"""Rounding errors are relative: values ten times as large may differ by ten times as much."""


def inputs(effort: Effort) -> dict[str, Values]:
    """Pictures, patterns and sinusoids of one size."""
    waves = made.sinusoids(SIDE, 2 if effort.quick else STEPS)
    return {**made.pictures(SIDE), **made.patterns(SIDE, SIDE), **waves}


def against_torch(effort: Effort) -> Iterator[Found | Skipped]:
    """onnxruntime against torch on pictures, patterns and sinusoids of all frequencies."""
    if missing := in_torch.missing():
        yield Skipped("onnxruntime against torch on patterns", missing)
        return
    names, images = _stacked(inputs(effort))
    for name in effort.models:
        difference = shipped.raw(name)(images) - shipped.torch_twin(name)(images)
        if shipped.is_int8(name):
            measured, where = worst(rms(difference) / LEVEL, names)
            yield Found(f"{name}: onnxruntime against torch, RMS, levels", ROUNDED_AWAY, measured, where)
        else:
            measured, where = worst(peak(difference), names)
            yield Found(f"{name}: onnxruntime against torch, worst value", UNSEEN, measured, where)


def against_float(effort: Effort) -> Iterator[Found]:
    """int8 against float on pictures, patterns and sinusoids of all frequencies."""
    given = inputs(effort)
    names, images = _stacked(given)
    count = len(made.pictures(SIDE))  # they come first
    base = Bicubic(2)(images)
    for name, twin in shipped.twins(effort):
        large, coarse = (np.clip(shipped.raw(each)(images), 0, 1) for each in (name, twin))
        difference = (coarse - large)[:count] / LEVEL
        measured, where = worst(rms(difference), names)
        yield Found(f"{twin}: against {name} on pictures, RMS, levels", INT8_RMS, measured, where)
        measured, where = worst(peak(difference), names)
        yield Found(f"{twin}: against {name} on pictures, worst pixel, levels", INT8_WORST, measured, where)
        measured, where = worst((rms(coarse - base) - rms(large - base)) / LEVEL, names)
        what = f"{twin}: further from bicubic than {name}, any input, RMS, levels"
        yield Found(what, INT8_FURTHER, measured, where)


def outside_the_range(effort: Effort) -> Iterator[Found | Skipped]:
    """Values outside [0, 1], up to +-10: refused; and the graph itself computes them as torch does."""
    wild = made.outside(SIDE, SIDE)
    names, images = _stacked(wild)
    for name in effort.models:
        model = catalogue.load_upscaler(name)
        taken = [key for key, image in wild.items() if not _refuses(model, image[None], "scale the pictures to [0, 1]")]
        yield Found(f"{name}: inputs outside [0, 1] that were not refused", 0, len(taken), ", ".join(taken))
    if missing := in_torch.missing():
        yield Skipped("onnxruntime against torch outside [0, 1]", missing)
        return
    for name in shipped.floats(effort):
        difference = peak(shipped.raw(name)(images) - shipped.torch_twin(name)(images))
        measured, where = worst(difference, names)
        what = f"{name}: onnxruntime against torch up to +-10, worst value"
        yield Found(what, SCALE_OUTSIDE * UNSEEN, measured, where)


def not_numbers(effort: Effort) -> Iterator[Found]:
    """NaN and infinity anywhere in a batch: refused with the index, never computed with."""
    random = np.random.default_rng(0)
    shape = (3, 3, 12, 17)
    for name in effort.models:
        model, passed = catalogue.load_upscaler(name), []
        for value in (np.nan, np.inf, -np.inf):
            for _ in range(4 if effort.quick else 40):
                index = tuple(int(random.integers(size)) for size in shape)
                images = np.full(shape, 0.5, np.float32)
                images[index] = value
                if not _refuses(model, images, f"{np.float32(value)} at index {index} "):
                    passed.append(f"{value} at {index}")
        yield Found(f"{name}: NaN and infinity not refused with their index", 0, len(passed), "; ".join(passed[:1]))


def denormals(effort: Effort) -> Iterator[Found]:
    """Denormal numbers come out as zeros do."""
    given = np.full((1, 3, SIDE, SIDE), made.DENORMAL, np.float32)
    for name in effort.models:
        model = catalogue.load_upscaler(name)
        measured = float(peak(model(given) - model(np.zeros_like(given)))[0])
        yield Found(f"{name}: 1e-40 everywhere against zero, worst value", UNSEEN, measured)


def _stacked(given: dict[str, Values]) -> tuple[list[str], Values]:
    return list(given), np.stack(list(given.values()))


def _refuses(model: object, images: Values, words: str) -> bool:
    """Whether `model` refuses `images` with an error of one line that holds `words`."""
    try:
        model(images)  # type: ignore[operator]
    except InvalidImage as error:
        return words in str(error) and "\n" not in str(error)
    return False


CASES: tuple[Case, ...] = (against_torch, against_float, outside_the_range, not_numbers, denormals)
