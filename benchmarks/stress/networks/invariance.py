"""What must not change the output, or must move it: shifts, flips, transposition, order, threads, tiles, time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found
from ciir.benchmarks.stress.networks import patterns as made
from ciir.benchmarks.stress.networks import shipped
from ciir.benchmarks.stress.networks.shipped import LEVEL, UNSEEN, box, peak, rms, worst
from ciir.models import catalogue, tiles
from ciir.models.sessions import count_available_cores

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ciir.benchmarks.stress.case import Case, Effort
    from ciir.benchmarks.stress.networks.shipped import Values

SIDE = 64
TURNED = 1.0
"""How large the change of the output by turning the input and turning back may be, in terms of the error to the truth.
Nothing makes a network treat left as right but its training pictures; but where turning changed more than the error
that it has anyway, it would have learnt an orientation and not what pictures look like."""
INT8_STEP = 1.0
"""Levels RMS for int8, whose codes may round to a neighbour where float rounding differs by a bit."""

TURNS: dict[str, Callable[[Values], Values]] = {
    "flipped left to right": lambda images: images[:, :, :, ::-1],
    "flipped upside down": lambda images: images[:, :, ::-1],
    "transposed": lambda images: images.transpose(0, 1, 3, 2),
}
"""Each is its own inverse."""


def shifts(effort: Effort) -> Iterator[Found]:
    """Input moved by one pixel: the output moves by two, away from the borders."""
    given = made.pictures(SIDE) if effort.quick else {**made.pictures(SIDE), **made.patterns(SIDE, SIDE)}
    images = np.stack(list(given.values()))
    for name in effort.models:
        run, edge = shipped.raw(name), shipped.card(name).radius + 1
        whole, found = run(images), {}
        inside = 2 * edge
        for way, axis in (("down", 2), ("across", 3)):
            keep, drop = [slice(None)] * 4, [slice(None)] * 4
            keep[axis], drop[axis] = slice(1, None), slice(2, None)
            moved = run(np.ascontiguousarray(images[tuple(keep)])) - whole[tuple(drop)]
            moved = moved[:, :, inside:-inside, inside:-inside]
            found[way] = _size(name, moved)
        names = [f"{key}, {way}" for way in found for key in given]
        measured, where = worst(np.concatenate(list(found.values())), names)
        yield _bounded(f"{name}: shifted by one pixel", name, measured, where)


def turns(effort: Effort) -> Iterator[Found]:
    """Flips and transposition: the change, in terms of the network's error on the same pictures."""
    truth = np.stack(list(made.pictures(2 * SIDE).values()))
    low, names = box(truth), list(made.pictures(2 * SIDE))
    for name in effort.models:
        run = catalogue.load_upscaler(name)
        large = run(low)
        error = rms(large - truth)
        found = {}
        for turn, turned in TURNS.items():
            change = turned(run(np.ascontiguousarray(turned(low)))) - large
            found[turn] = rms(change) / error
        labels = [f"{key} {turn}" for turn in found for key in names]
        measured, where = worst(np.concatenate(list(found.values())), labels)
        yield Found(f"{name}: turned and back, change over error", TURNED, measured, where)


def order(effort: Effort) -> Iterator[Found]:
    """A batch in another order, and a second run: the same bits."""
    images = np.stack([*made.pictures(SIDE // 2).values(), *made.patterns(SIDE // 2, SIDE // 2).values()])
    mixed = np.random.default_rng(0).permutation(len(images))
    for name in effort.models:
        run = catalogue.load_upscaler(name)
        large = run(images)
        moved = float(peak(run(images[mixed]) - large[mixed]).max())
        yield Found(f"{name}: a batch in another order, worst value", 0, moved)
        again = [float(peak(run(images) - large).max()) for _ in range(2 if effort.quick else 10)]
        yield Found(f"{name}: run again, worst value", 0, max(again))


def threads(effort: Effort) -> Iterator[Found]:
    """1, 2, 3 and more threads: the same within half a level of 16 bits."""
    images = np.stack(list(made.pictures(SIDE).values()))
    counts = (2,) if effort.quick else tuple(sorted({2, 3, 4, 7, count_available_cores()}))
    for name in effort.models:
        alone = shipped.raw(name, threads=1)(images)
        found = []
        for count in counts:
            difference = shipped.raw(name, threads=count)(images) - alone
            found.append(float(_size(name, difference).max()))
        measured, where = worst(np.array(found), [f"{count} threads" for count in counts])
        yield _bounded(f"{name}: against one thread", name, measured, where)


def tile_sizes(effort: Effort) -> Iterator[Found]:
    """Tiles of different sizes: the same within half a level of 16 bits."""
    image = made.natural(150, 130)[None]
    for name in effort.models:
        run, card = shipped.raw(name), shipped.card(name)
        whole = run(image)
        found = {}
        for side in (48,) if effort.quick else (2 * card.radius + 8, 40, 48, 64, 97):
            tiled = tiles.run_in_tiles(
                run, image, scale=card.scale, radius=card.radius, tile_pixels=side * side, batch_pixels=1
            )
            found[f"tiles of {side}x{side}"] = _size(name, tiled - whole)
        measured, where = worst(np.concatenate(list(found.values())), list(found))
        yield _bounded(f"{name}: in tiles", name, measured, where)


def _size(name: str, difference: Values) -> Values:
    """How large the difference is in the measure of `_bounded`, for each picture."""
    return rms(difference) / LEVEL if shipped.is_int8(name) else peak(difference)


def _bounded(what: str, name: str, measured: float, where: str) -> Found:
    if shipped.is_int8(name):
        return Found(f"{what}, RMS, levels", INT8_STEP, measured, where)
    return Found(f"{what}, worst value", UNSEEN, measured, where)


CASES: tuple[Case, ...] = (shifts, turns, order, threads, tile_sizes)
