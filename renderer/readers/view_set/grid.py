"""Finds the grid that views fill from the numbers in their names."""

from __future__ import annotations

import math
import posixpath
import re
from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Literal

from ciir.errors import InvalidOption
from ciir.renderer.readers.names import clean_text
from ciir.renderer.readers.view_set.numbered_names import NumberedNames, find_step, group_by_kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.views import DepthSense

ROW_LABELS = frozenset({"row", "r", "v", "y", "t"})
COLUMN_LABELS = frozenset({"column", "col", "c", "u", "x", "s"})
"""Letters before a number that show what it counts."""
MOST_LEFT_OUT = 3
"""The most pictures with names of another kind that are left out of a set; more than these are a set of their own."""
MOST_MISSING = 3
"""The most views that a square may lack to be suspected."""
_SEPARATOR = re.compile(r"[-_.,x /]")


@dataclass(frozen=True)
class Grid:
    """Files in the rows and columns of their views."""

    files: tuple[tuple[str, ...], ...]
    naming: str = ""
    """The parts of the names that were taken as row and column, for a note; empty if there was nothing to decide."""
    transposed_naming: str = ""
    """The same with rows and columns exchanged."""
    depth_sense: DepthSense = "cameras"
    left_out: tuple[str, ...] = ()
    """Pictures whose names are unlike those of the views."""
    is_filled: bool = False
    """Whether the names have one number or none, so that they may also be one row of views."""
    missing: int = 0
    """Views that are missing if this is the grid: it has the complete rows of a square, and other files are left."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of views."""
        return len(self.files), len(self.files[0])


@dataclass(frozen=True)
class _Wish:
    name: str
    """The name of the set in messages."""
    shape: tuple[int, int] | None
    first: Literal["row", "column"] | None


def find_grids(
    files: Sequence[str],
    name: str,
    *,
    shape: tuple[int, int] | None = None,
    first: Literal["row", "column"] | None = None,
) -> list[Grid]:
    """Finds the grids that pictures named `files`, in natural order, may fill; the most probable first.

    - Two of the numbers in the names are row and column, whichever make a full grid: `view_VV_UU`, `NAME_R_C`,
      `out_RR_CC_Y_X` (Stanford, http://lightfield.stanford.edu). They are counted from 0, 1 or later, with any other
      numbers around them. The first one is the row, unless `first` or letters before both numbers (`x3_y4`) state
      otherwise, or only the other way fits `shape`, the rows and columns of views.
    - One number, or none, fills `shape`, or a square, row by row (`input_CamNNN`, HCI 4D Light Field Benchmark), or
      column by column if `first` is `column`. If that leaves the number of rows open, there are several grids. Some of
      them have `missing` views, if these would make a square.

    A few pictures with other names are left out of a set that is full without them.

    Raises `InvalidOption` if views are missing, if names are of several kinds, or if `shape` doesn't fit.
    """
    wish = _Wish(name, shape, first)
    if len(files) == 1 and shape in (None, (1, 1)):
        return [Grid(((files[0],),))]
    kinds = group_by_kind(files)
    names = max(kinds, key=lambda kind: len(kind.files))
    if not names.varying:
        return _fill(files, wish)
    others = tuple(sorted(set(files) - set(names.files)))
    if len(others) >= len(names.files) or any(len(kind.files) > MOST_LEFT_OUT for kind in kinds if kind is not names):
        raise InvalidOption(
            f"{name}: the names are of different kinds ({clean_text(names.files[0])}, {clean_text(others[0])}) and "
            "give no grid of views; keep one set of views, or name them all alike, as in view_VV_UU.png"
        )
    pairs = [*combinations(names.varying, 2)] or _pair_with_constant(names, wish)
    full = [pair for pair in pairs if _is_full(*map(names.values, pair))]
    if full:
        grids = [_make_grid(names, *_select_pair(names, full, wish))]
    else:
        numbers = names.values(_select_running(names, pairs, wish))
        grids = _fill([file for _, file in sorted(zip(numbers, names.files, strict=True))], wish, others)
    return [replace(grid, left_out=others) for grid in grids]


def _pair_with_constant(names: NumberedNames, wish: _Wish) -> list[tuple[int, int]]:
    """Returns the only number that varies paired with a constant one next to it, if that is its row or column.

    A constant larger than the number of pictures is taken for a scene's number.
    """
    (slot,) = names.varying
    if wish.shape is not None and 1 not in wish.shape:
        return []
    for pair, constant in (((slot - 1, slot), slot - 1), ((slot, slot + 1), slot + 1)):
        if not 0 <= constant < len(names.texts) or constant in names.positions:
            continue
        is_beside = _SEPARATOR.fullmatch(names.texts[pair[1]]) is not None
        if is_beside and (wish.shape is not None or names.values(constant)[0] <= len(names.files)):
            return [pair]
    return []


def _select_pair(names: NumberedNames, full: Sequence[tuple[int, int]], wish: _Wish) -> tuple[int, int]:
    """Selects the numbers that are row and column: among pairs that make a full grid, the one counted by ones and from
    0 or 1.
    """

    def rank(pair: tuple[int, int]) -> tuple[bool, bool]:
        values = [names.values(slot) for slot in pair]
        return any(find_step(each) != 1 for each in values), max(map(min, values)) > 1

    one, other = min(full, key=rank)
    return (one, other) if _is_row_first(names, (one, other), wish) else (other, one)


def _is_full(one: Sequence[int], other: Sequence[int]) -> bool:
    """Returns whether each value of `one` meets each of `other` once, and both are evenly spaced."""
    count = len(set(one)) * len(set(other))
    return count == len(one) == len(set(zip(one, other, strict=True))) and all(map(find_step, (one, other)))


def _is_row_first(names: NumberedNames, pair: tuple[int, int], wish: _Wish) -> bool:
    counts = len(set(names.values(pair[0]))), len(set(names.values(pair[1])))
    fits = {"row": wish.shape in (None, counts), "column": wish.shape in (None, counts[::-1])}
    if wish.shape is not None and not (fits[wish.first] if wish.first else any(fits.values())):
        given = counts[::-1] if wish.first == "column" else counts
        raise InvalidOption(
            f"pixels: {wish.shape[0]}x{wish.shape[1]} is not the {given[0]}x{given[1]} grid of views that the names in "
            f"{wish.name} give; leave the option out or rename the pictures"
        )
    if wish.first is not None or not all(fits.values()):
        return wish.first == "row" if wish.first else fits["row"]
    labels = [(re.findall(r"[a-z]+", names.texts[slot]) or [""])[-1] for slot in pair]
    return not (labels[0] in COLUMN_LABELS and labels[1] in ROW_LABELS)


def _make_grid(names: NumberedNames, row: int, column: int) -> Grid:
    by_place = {place: at for at, place in enumerate(zip(names.values(row), names.values(column), strict=True))}
    rows, columns = (sorted({place[axis] for place in by_place}) for axis in (0, 1))
    lines = [[by_place[r, c] for c in columns] for r in rows]
    shown = _shorten(names.files[lines[0][-1]], names.files)
    part = ""
    if max(rows[0], columns[0]) > 1:
        part = f" (a part of a larger set, from ({rows[0]}, {columns[0]}), counted from (0, 0) here)"
    if (step := max(map(find_step, (rows, columns)))) > 1:
        part += f" (in steps of {step})"

    def describe(first: str, second: str) -> str:
        low, high = (rows[0], columns[-1]) if row < column else (columns[-1], rows[0])
        return f"in {shown} {low} is the {first} and {high} the {second}{part}"

    namings = [describe(*words) for words in (("row", "column"), ("column", "row"))]
    naming, transposed_naming = namings if row < column else namings[::-1]
    depth_sense = _find_depth_sense([names.numbers[at] for at in lines[0]], names.positions)
    files = tuple(tuple(names.files[at] for at in line) for line in lines)
    return Grid(files, naming, transposed_naming, depth_sense)


def _shorten(file: str, files: Sequence[str]) -> str:
    """Returns the path of `file` without the folders that all `files` are in."""
    common = posixpath.commonprefix([PurePosixPath(each).parts[:-1] for each in files])
    return clean_text("/".join(PurePosixPath(file).parts[len(common) :]))


def _find_depth_sense(row: Sequence[Sequence[str]], positions: Sequence[int]) -> DepthSense:
    """Returns `lenses` if the positions in the names of a row of cameras, Y and X as in Stanford's, go to the left."""
    return "lenses" if len(positions) > 1 and float(row[0][positions[1]]) > float(row[-1][positions[1]]) else "cameras"


def _describe_gap(names: NumberedNames, pairs: Sequence[tuple[int, int]], name: str) -> str:
    """Returns the message for names in which none of `pairs` makes a full grid."""
    places = {pair: Counter(zip(*map(names.values, pair), strict=True)) for pair in pairs}
    single = [pair for pair in pairs if max(places[pair].values()) == 1]
    if not single:
        stems = Counter(str(PurePosixPath(file).with_suffix("")) for file in names.files)
        if twice := [stem for stem, count in stems.items() if count > 1]:
            return f"{name}: {clean_text(twice[0])} occurs with two suffixes; give each view once"
        return (
            f"{name}: no two of the {len(names.varying)} numbers that differ in names such as "
            f"{clean_text(names.files[0])} make a full grid of {len(names.files)} views; give one set of views, or "
            "name them view_VV_UU.png"
        )
    best = min(single, key=lambda pair: math.prod(len(set(names.values(slot))) for slot in pair))
    columns_of: defaultdict[int, set[int]] = defaultdict(set)
    for row, column in places[best]:
        columns_of[row].add(column)
    columns = set().union(*columns_of.values())
    starts = [0 if 0 in values else min(values) for values in (columns_of.keys(), columns)]
    last = max(columns_of), max(columns)
    row = next((row for row in range(starts[0], last[0]) if columns_of.get(row) != columns), last[0])
    missing = next((c for c in range(starts[1], last[1] + 1) if c not in columns_of[row]), starts[1])
    return (
        f"{name}: the names go from ({starts[0]}, {starts[1]}) to {last}, but there is no view ({row}, {missing}); add "
        "it, or leave out the rest of its row or column"
    )


def _select_running(names: NumberedNames, pairs: Sequence[tuple[int, int]], wish: _Wish) -> int:
    """Selects the one number that counts the views.

    Raises `InvalidOption` if no number counts them without gaps. A single number may have gaps if the shape was given.
    """
    count = len(names.files)
    for slot in names.varying:
        if len(set(names.values(slot))) == count and find_step(names.values(slot)):
            return slot
    if pairs:
        raise InvalidOption(_describe_gap(names, pairs, wish.name))
    (slot,) = names.varying
    if wish.shape is None:
        before, after = next(pair for pair in pairwise(sorted(names.values(slot))) if pair[1] != pair[0] + 1)
        what = f"two have number {after}" if after == before else f"number {before + 1} is missing"
        raise InvalidOption(
            f"{wish.name}: of the views named like {clean_text(names.files[0])} {what}; give all of them, or give "
            "pixels ROWSxCOLUMNS (of views) to take those that are there"
        )
    return slot


def _fill(files: Sequence[str], wish: _Wish, left_out: Sequence[str] = ()) -> list[Grid]:
    """Returns the grids of `wish.shape`, or else of a square, or of any size, that `files` fill one after another."""
    count, shape = len(files), wish.shape
    side = math.isqrt(count)
    if shape is not None and shape[0] * shape[1] != count:
        raise InvalidOption(
            f"pixels: {shape[0]}x{shape[1]} asks for {shape[0] * shape[1]} views, but {wish.name} holds {count} "
            "pictures; give the rows and columns of the views that are there"
        )
    if shape is not None:
        shapes = [shape, shape[::-1]]
    elif side**2 == count:
        shapes = [(side, side)]
    else:
        shapes = [(rows, count // rows) for rows in range(3, count // 3 + 1) if count % rows == 0]
        shapes.sort(key=lambda shape: abs(shape[0] - shape[1]))
    if not shapes:
        raise InvalidOption(describe_unknown_shape(wish.name, count, left_out))
    by_column = wish.first == "column"
    whole = [_wrap(files, *counts, by_column=by_column) for counts in dict.fromkeys(shapes)]
    return [*whole, *(_list_incomplete_squares(files, by_column=by_column) if len(whole) > 1 else [])]


def _list_incomplete_squares(files: Sequence[str], *, by_column: bool) -> list[Grid]:
    """Returns the complete rows of the square that `files` are if a few are missing at the end, or at the start."""
    side = math.isqrt(len(files)) + 1
    missing, rest = side**2 - len(files), len(files) % side
    if missing > MOST_MISSING or side <= MOST_MISSING:
        return []
    shape = (side, side - 1) if by_column else (side - 1, side)
    return [
        replace(_wrap(some, *shape, by_column=by_column), missing=missing)
        for some in (files[: len(files) - rest], files[rest:])
    ]


def describe_unknown_shape(name: str, count: int, left_out: Sequence[str]) -> str:
    """Returns the message for `count` pictures that may fill several grids, besides those `left_out`."""
    others = f" ({len(left_out)} with other names not counted, such as {clean_text(left_out[0])})" if left_out else ""
    return (
        f"{name}: {count} pictures without rows and columns in their names{others}, and not a square number; give "
        "pixels ROWSxCOLUMNS (of views), or name them view_VV_UU.png"
    )


def _wrap(files: Sequence[str], rows: int, cols: int, *, by_column: bool) -> Grid:
    """Returns the grid that `files` fill row by row, or column by column."""
    length = rows if by_column else cols
    lines = [tuple(files[at : at + length]) for at in range(0, len(files), length)]
    end = _shorten(lines[0][-1], files)
    namings = [f"the names fill {each}s, {end} ends the first" for each in ("row", "column")]
    if by_column:
        return Grid(tuple(zip(*lines, strict=True)), namings[1], namings[0], is_filled=True)
    return Grid(tuple(lines), namings[0], namings[1], is_filled=True)
