"""Scores of pictures and light fields against their truth."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ciir.training.evaluation import light_fields, pictures
from ciir.training.evaluation.folders import compare_by_name, is_set
from ciir.training.evaluation.maps import is_map
from ciir.training.evaluation.metrics import average, compute_psnr
from ciir.training.evaluation.pairs import White, check_sizes, score_view
from ciir.training.evaluation.placed_views import read_all, read_some

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from ciir.renderer.readers.layout import Layout
    from ciir.renderer.views import View
    from ciir.training.evaluation.placed_views import PlacedViews

CLOSER = 1.0
"""By how many dB views must be closer to the truth in one order for the pictures to show that it is right."""
PROTOCOL = (
    "Mean over the views or pictures of PSNR (dB) and SSIM of Y (ITU-R BT.601, studio range, not rounded, of 8-bit "
    "RGB; grey is its own Y) after rounding to 8 bits; a border of `scale` pixels is cut. White of 16-bit files is the "
    "largest level of the bits that the truth uses (8, 10, 12, 14 or 16; 16 if the truth has 8-bit files), and higher "
    "levels of results are clipped. SSIM: Wang et al. 2004, 11x11 Gaussian window of sigma 1.5, valid region, K 0.01 "
    "and 0.03, L 255. The mean PSNR is that of views or pictures that aren't identical, if there are any. Disparity "
    "maps: BadPix(0.07), the share of pixels whose disparity is off by more than 0.07, and 100 times the mean square "
    "error, as in the HCI 4D light field benchmark, over the pixels that are finite in the truth and whose confidence "
    "in the truth's NAME_confidence, if there is that file, isn't 0. Those that aren't finite in the result are bad, "
    "and the mean square error is without them."
)


def compare(
    result: Path, truth: Path, *, border: int, layout: Layout | None = None
) -> light_fields.Measured | pictures.Measured:
    """Scores each view or picture of `result` against that of `truth`, of the same size.

    A border of `border` pixels is cut. Both are pictures or light fields. A folder or zip with some views that
    `ciir reconstruct` wrote is compared with the views at the same (v, u). If the places of views in two folders or
    zips are unknown, their pictures are compared by name (`folders.compare_by_name`). `layout`: how views lie in both
    files, if the caller knows; both are then read as whole light fields.

    If views are counted from other ends in the two files, as their depth senses state, they are compared in the same
    order. If the pictures clearly show the other order, they are compared in that one, with a note.

    Raises `ValueError` if one can't be read, or their views differ in number, size or channels.
    """
    paths = result, truth
    for path in paths:
        if not path.exists():
            raise ValueError(f"{path}: no such folder or file; give a result and its truth")
    if layout is None and is_map(result):
        raise ValueError(
            f"{result}: a disparity map, but {truth} isn't one; give pictures or light fields, or two maps"
        )
    are_sets = layout is None and is_set(result) and is_set(truth)
    some = [read_some(path) if layout is None else None for path in paths]
    grids: set[tuple[int, int] | None] = set()
    try:
        found, true = (part or read_all(path, layout) for part, path in zip(some, paths, strict=True))
        grids = {found.grid, true.grid} - {None}
    except ValueError:
        if not are_sets:
            raise
    if are_sets and (not grids or (1, 1) in grids):
        by_name = compare_by_name(result, truth, border=border)
        if some.count(None) != 1:
            return by_name
        own, other = (path.name for path in (paths if some[0] else paths[::-1]))
        note = f"{other} isn't a whole grid of views: its names must count views from 0, as those of {own} do"
        return by_name._replace(notes=(*by_name.notes, note))
    if (1, 1) in grids and len(found.views) == len(true.views) == 1:
        found, true = found.place_alone(), true.place_alone()
    return _compare_views(found, true, paths, border=border)


def _compare_views(
    found: PlacedViews, true: PlacedViews, paths: tuple[Path, Path], *, border: int
) -> light_fields.Measured:
    result, truth = paths
    grid = rows, cols = true.grid or found.grid or (1, 1)
    if found.grid == (1, 1) != grid:
        where = f"a picture in {truth}" if truth.is_dir() else f"which `ciir convert {truth} -o FOLDER` writes"
        raise ValueError(f"{result}: one view, but {truth} has {rows}x{cols}; give the same view as the truth, {where}")
    made, wanted = ((*(each.grid or grid), *next(iter(each.views.values())).shape) for each in (found, true))
    check_sizes(str(result), made, str(truth), wanted, border=border)
    white = White(true.views.values())
    orders = [found.views, {(rows - 1 - v, cols - 1 - u): view for (v, u), view in found.views.items()}]
    is_reversed = found.depth_sense != true.depth_sense and grid != (1, 1)
    psnr = [_compare_farthest(views, true.views, grid, white, border=border) for views in orders]
    notes = [*found.notes, *(note for note in true.notes if note not in found.notes)]
    if psnr[not is_reversed] > psnr[is_reversed] + CLOSER:
        is_reversed = not is_reversed
        shown = "lenses" if found.depth_sense == "cameras" else "cameras"
        notes.append(
            f"{result.name} is read with the depth sense {found.depth_sense}, but against {truth.name} "
            f"({true.depth_sense}) its pictures show {shown}: they are compared so; read it with depth_sense {shown}"
        )
    elif is_reversed:
        notes.append(f"views of {result.name} are counted from the other end than those of {truth.name}: put right")
    views = orders[is_reversed]
    scores = {
        place: score_view(views[place], view, white, border=border)
        for place, view in true.views.items()
        if place in views
    }
    if not scores:
        raise ValueError(f"{result}: none of its views is in {truth}; give the same views in both")
    if len(scores) < max(len(views), len(true.views)):
        compared = f"{len(scores):,} of {len(true.views):,} views of {truth.name}"
        extra = len(views) - len(scores)
        left_out = f"; {extra:,} more in {result.name} are left out" if extra else ""
        notes.append(f"{compared} are compared with those at the same place in {result.name}{left_out}")
    notes += white.describe(result.name, truth.name)
    return light_fields.Measured(average(result.name, scores), scores, tuple(notes))


def _compare_farthest(
    made: Mapping[View, NDArray[Any]],
    wanted: Mapping[View, NDArray[Any]],
    grid: tuple[int, int],
    white: White,
    *,
    border: int,
) -> float:
    """Returns the mean PSNR (dB) of the views that are farthest from the grid's centre; NaN if there are none."""
    both: dict[int, list[View]] = {}
    for v, u in made.keys() & wanted.keys():
        both.setdefault(abs(2 * v - grid[0] + 1) + abs(2 * u - grid[1] + 1), []).append((v, u))
    psnr = [
        compute_psnr(white.make_luma(made[view]), white.make_luma(wanted[view]), border=border)
        for view in both.get(max(both, default=0), [])
    ]
    return sum(psnr) / len(psnr) if psnr else math.nan
