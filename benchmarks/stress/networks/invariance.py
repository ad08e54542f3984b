"""Changes that must not alter the output, or must move it: shifts, flips, transposition, order, threads, tiles,
repetition.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found
from ciir.benchmarks.stress.networks import patterns, shipped
from ciir.benchmarks.stress.networks.shipped import bound_difference, downsample, find_worst, peak, rms
from ciir.cores import count_available_cores
from ciir.models import catalogue, tiles

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ciir.benchmarks.stress.case import Case, Effort
    from ciir.benchmarks.stress.networks.shipped import Values

SIDE = 64
CHANGE = 1.0
"""How much flipping the input and back may change the output, relative to the error to the truth. No filter is tied to
its mirror image, but a change above the error would mean that the network prefers an orientation."""
INT8_STEP = 1.0
"""Levels RMS for int8, whose codes may round to a neighbour if float rounding differs by a bit."""

SYMMETRIES: dict[str, Callable[[Values], Values]] = {
    "flipped left to right": lambda images: images[:, :, :, ::-1],
    "flipped upside down": lambda images: images[:, :, ::-1],
    "transposed": lambda images: images.transpose(0, 1, 3, 2),
}
"""Changes that are each their own inverse."""


def shifts(effort: Effort) -> Iterator[Found]:
    """Moves the input by one pixel: the output moves by two, away from the borders."""
    inputs = patterns.make_pictures(SIDE)
    if not effort.quick:
        inputs |= patterns.make_patterns(SIDE, SIDE)
    images = np.stack(list(inputs.values()))
    for name in effort.models:
        network, margin = shipped.load_network(name), 2 * (shipped.read_card(name).radius + 1)
        whole = network(images)
        for way, axis in (("down", 2), ("across", 3)):
            keep, drop = [slice(None)] * 4, [slice(None)] * 4
            keep[axis], drop[axis] = slice(1, None), slice(2, None)
            moved = network(np.ascontiguousarray(images[tuple(keep)])) - whole[tuple(drop)]
            inner = moved[:, :, margin:-margin, margin:-margin]
            yield bound_difference(f"shifted by one pixel {way}", name, inner, list(inputs), int8_rms=INT8_STEP)


def symmetries(effort: Effort) -> Iterator[Found]:
    """Flips and transposes pictures, and measures the change relative to the network's error on the same pictures."""
    inputs = patterns.make_pictures(2 * SIDE)
    truth = np.stack(list(inputs.values()))
    low = downsample(truth)
    for name in effort.models:
        model = catalogue.load_upscaler(name)
        large = model(low)
        changes = [flip(model(np.ascontiguousarray(flip(low)))) - large for flip in SYMMETRIES.values()]
        relative = np.concatenate([rms(change) / rms(large - truth) for change in changes])
        names = [f"{key} {way}" for way in SYMMETRIES for key in inputs]
        yield find_worst(f"{name}: flipped or transposed and back, change over error", CHANGE, relative, names)


def order(effort: Effort) -> Iterator[Found]:
    """Runs a batch in another order, and a second time: the same bits."""
    side = SIDE // 2
    images = np.stack([*patterns.make_pictures(side).values(), *patterns.make_patterns(side, side).values()])
    mixed = np.random.default_rng(0).permutation(len(images))
    for name in effort.models:
        model = catalogue.load_upscaler(name)
        large = model(images)
        moved = float(peak(model(images[mixed]) - large[mixed]).max())
        yield Found(f"{name}: a batch in another order, worst value", 0, moved)
        again = [float(peak(model(images) - large).max()) for _ in range(2 if effort.quick else 10)]
        yield Found(f"{name}: run again, worst value", 0, max(again))


def threads(effort: Effort) -> Iterator[Found]:
    """Runs 1, 2, 3 and more threads: the same within half a level of 16 bits."""
    inputs = patterns.make_pictures(SIDE)
    images = np.stack(list(inputs.values()))
    counts = (2,) if effort.quick else tuple(sorted({2, 3, 4, 7, count_available_cores()}))
    for name in effort.models:
        single = shipped.load_network(name, threads=1)(images)
        difference = np.concatenate([shipped.load_network(name, threads=count)(images) - single for count in counts])
        names = [f"{count} threads, {key}" for count in counts for key in inputs]
        yield bound_difference("against one thread", name, difference, names, int8_rms=INT8_STEP)


def tile_sizes(effort: Effort) -> Iterator[Found]:
    """Runs tiles of different sizes: the same within half a level of 16 bits."""
    image = patterns.make_natural(150, 130)[None]
    for name in effort.models:
        network, card = shipped.load_network(name), shipped.read_card(name)
        whole = network(image)
        sides = (48,) if effort.quick else (2 * card.radius + 8, 40, 48, 64, 97)
        tiled = [
            tiles.run_in_tiles(
                partial(_run_whole, network),
                image,
                scale=card.scale,
                radius=card.radius,
                tile_pixels=side * side,
                batch_pixels=1,
            )
            for side in sides
        ]
        names = [f"tiles of {side}x{side}" for side in sides]
        yield bound_difference("in tiles", name, np.concatenate(tiled) - whole, names, int8_rms=INT8_STEP)


def _run_whole(network: Callable[[Values], Values], images: Values, _: int) -> Values:
    return network(images)


CASES: tuple[Case, ...] = (shifts, symmetries, order, threads, tile_sizes)
