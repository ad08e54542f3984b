"""Views by their indices (v, u), the text that selects them, their order, and how elemental images were taken."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

View = tuple[int, int]
"""(v, u): the row and the column of the view's pixel under each lens, from the top left."""

Flip = Literal["none", "u", "v", "uv"]
"""The order of views that is reversed: that of the columns u, of the rows v, or of both."""

Pickup = Literal["virtual", "optical"]
"""How an elemental image was taken: upright, as by a virtual camera, or rotated by 180 degrees, as by a lens."""

DepthSense = Literal["lenses", "cameras"]
"""How content moves with depth from one view to the next on the right.

- `lenses`: u counts pixels under a lens, so that content farther from the lens array moves further to the left;
- `cameras`: u counts cameras from the left, so that nearer content moves further to the left.

Reversing the order of views in v and in u turns one into the other."""


def is_turned(pickup: Pickup) -> bool:
    """Returns whether elemental images are turned by 180 degrees. Raises `InvalidOption` for an unknown `pickup`."""
    if pickup not in ("virtual", "optical"):
        raise InvalidOption(f"pickup: {pickup!r} is not known; give virtual or optical")
    return pickup == "optical"


def check_depth_sense(sense: str) -> None:
    """Raises `InvalidOption` for an unknown depth sense."""
    if sense not in ("lenses", "cameras"):
        raise InvalidOption(f"depth_sense: {sense!r} is not known; give cameras or lenses")


def spread_indices(start: int, stop: int, most: int) -> NDArray[np.int64]:
    """Returns up to `most` of the rows or columns from `start` to before `stop`, evenly spread, with both ends."""
    indices: NDArray[np.int64] = np.unique(np.linspace(start, stop - 1, min(most, stop - start)).round().astype(int))
    return indices


def center_view(pixels_v: int, pixels_u: int) -> View:
    """Returns the view nearest to the lenses' axis; the lower right one of the middle four if counts are even."""
    return pixels_v // 2, pixels_u // 2


def parse_views(spec: str, pixels_v: int, pixels_u: int) -> list[View]:
    """Returns the views that `spec` selects from `pixels_v x pixels_u`.

    `center`; `cross` (upper, left, centre, right, lower: the paper's figure 4), each view once; `all`, row by row; or
    pairs `v,u;v,u`. Raises `InvalidOption` for other text and for a view that doesn't exist.
    """
    v, u = center_view(pixels_v, pixels_u)
    if spec == "center":
        return [(v, u)]
    if spec == "cross":
        return list(dict.fromkeys([(0, u), (v, 0), (v, u), (v, pixels_u - 1), (pixels_v - 1, u)]))
    if spec == "all":
        return [(v, u) for v in range(pixels_v) for u in range(pixels_u)]
    pairs = []
    for pair in spec.split(";"):
        match = re.fullmatch(r"\s*(\d{1,6})\s*,\s*(\d{1,6})\s*", pair)
        if match is None:
            raise InvalidOption(
                f"views: {spec[:80]!r} is not understood; give center, cross, all, or pairs such as 0,0;7,7"
            )
        v, u = int(match[1]), int(match[2])
        if v >= pixels_v or u >= pixels_u:
            raise InvalidOption(
                f"views: {v},{u} is not there; of {pixels_v}x{pixels_u} views (pixels under each lens) v goes from 0 "
                f"to {pixels_v - 1} and u from 0 to {pixels_u - 1}"
            )
        pairs.append((v, u))
    return list(dict.fromkeys(pairs))


def read_index(value: Any, count: int) -> int | None:
    """Returns a whole number from 0 to below `count`, also one of numpy's types; None for anything else."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return int(value) if is_whole and 0 <= value < count else None


def flip_axes(grid: NDArray[Any], axes: Flip, depth_sense: DepthSense) -> tuple[NDArray[Any], DepthSense]:
    """Returns `grid`, whose first two axes are v and u, with `axes` reversed, and its depth sense (`LightField.flip`).

    Raises `InvalidOption` for unknown axes.
    """
    if axes not in get_args(Flip):
        raise InvalidOption(f"flip: {axes!r} is not known; give {', '.join(get_args(Flip))}")
    flipped = grid[:: -1 if axes in ("v", "uv") else 1, :: -1 if axes in ("u", "uv") else 1]
    if axes in ("u", "uv"):
        return flipped, "lenses" if depth_sense == "cameras" else "cameras"
    return flipped, depth_sense


def advise_axes(shape: Sequence[int], name: str) -> str:
    """Returns the end of a message that asks for `(V, U, H, W, C)`: how to make it from an array `name` of
    `(V, U, C, H, W)` or `(C, V, U, H, W)`, also with the views' axes last, or of grey views `(V, U, H, W)`, and what to
    do with an array that may be an elemental image array.
    """
    if len(shape) == 5:
        return _advise_five_axes(shape, name)
    if len(shape) == 4 and shape[3] > 4:
        return f"; for grey views (V, U, H, W), as in {name}[..., None]"
    if len(shape) == 2 or (len(shape) == 3 and shape[2] <= 4):
        return "; for an elemental image array, use LightField.from_eia"
    return ""


def _advise_five_axes(shape: Sequence[int], name: str) -> str:
    """Does the same as `advise_axes` for five axes, assuming that views have more pixels than there are views."""
    if shape[0] in (1, 3) and min(shape[1:3]) > max(shape[3:]):
        return f"; for (C, H, W, V, U), as in {name}.transpose(3, 4, 1, 2, 0)"
    if shape[4] > 4 >= shape[2] and min(shape[:2]) > max(shape[3:]):
        return f"; for (H, W, C, V, U), as in {name}.transpose(3, 4, 0, 1, 2)"
    if shape[4] > 4 >= shape[2]:
        return f"; for (V, U, C, H, W), as in np.moveaxis({name}, 2, -1)"
    if shape[0] in (1, 3) and max(shape[1:3]) < min(shape[3:]):
        return f"; for (C, V, U, H, W), as in np.moveaxis({name}, 0, -1)"
    return ""
