"""Warps pictures: moves the content of each pixel along one axis by its own distance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.models.single.interpolation import KEYS_A

if TYPE_CHECKING:
    from ciir.models.light_field.disparities.shifts import Plane

TAPS = (-1, 0, 1, 2)
"""Pixels that cubic convolution combines, relative to the one before the place."""
EDGE = 3
"""Pixels that are added on each side, so that all taps of a place just beyond the border exist."""


def pad_edges(picture: Plane, axis: int) -> Plane:
    """Returns `picture` `(H, W)` with its edge pixels repeated along `axis`, as `warp_picture` needs it."""
    return np.pad(picture, [(EDGE, EDGE) if side == axis else (0, 0) for side in range(2)], mode="edge")


def warp_picture(padded: Plane, moved: Plane, axis: int, *, first_row: int = 0) -> Plane:
    """Returns a picture `(H, W)` at the pixels of some of its rows, from `first_row` on, each moved along `axis` by
    `moved` pixels, `(h, W)`, by cubic convolution (Keys, IEEE TASSP 29(6), 1981).

    `padded`: the picture from `pad_edges` for the same axis. Beyond the border its edge pixels are repeated.
    """
    places = np.arange(padded.shape[axis] - 2 * EDGE, dtype=np.float32)
    place = moved + (places[first_row : first_row + len(moved), None] if axis == 0 else places)
    np.clip(place, -1, len(places), out=place)
    before = np.floor(place)
    place -= before
    before += 1  # so that none is negative
    near = before.astype(np.intp)
    width = padded.shape[1]
    if axis == 0:
        near *= width
        near += np.arange(width)
    else:
        near += width * np.arange(first_row, first_row + len(moved))[:, None]
    flat, step = padded.ravel(), width if axis == 0 else 1
    parts = weigh_taps(place)
    for tap, part in zip(TAPS, parts, strict=True):
        np.multiply(part, flat[(EDGE - 1 + tap) * step :].take(near), out=part)
    result, *others = parts
    for part in others:
        result += part
    return result


def weigh_taps(share: Plane) -> list[Plane]:
    """Returns the weights of `TAPS` at a place that is `share` of a pixel after the pixel before it: Keys' kernel."""
    rest = 1 - share
    product = share * rest
    product *= np.float32(KEYS_A)
    first, last = product * rest, product * share
    near = np.float32(KEYS_A + 2) * share
    near -= np.float32(KEYS_A + 3)
    near *= share
    near *= share
    near += 1
    rest[...] = 1
    for other in (first, near, last):
        rest -= other
    return [first, near, rest, last]
