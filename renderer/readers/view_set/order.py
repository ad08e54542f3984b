"""Puts views into the order that was asked for, or that the pictures show."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.view_set.view_files import ViewFiles
from ciir.renderer.view_order.estimate import estimate_order, reverse_every_other_row

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.layout import OrderCheck
    from ciir.renderer.view_order.estimate import OrderEstimate

Views = TypeVar("Views", LightField, ViewFiles)


def is_automatic(layout: Layout) -> bool:
    """Returns whether the pictures may decide the order, because nothing was asked for."""
    return layout.order == "auto" and layout.flip == "none" and not layout.transpose


ASKED = ("given", "rows", "columns", "serpentine")
"""Orders that the pictures can't change."""


def unwind(views: Views) -> Views:
    """Returns the views with every other row reversed, starting with the second: the order in which a gantry that moves
    to and fro takes them.
    """
    return _replace_grid(views, reverse_every_other_row(_find_grid(views)))


def take_order(views: Views, order: OrderCheck) -> Views:
    """Returns views with rows first, from the left. Their first index is the row, or the column for `order` columns."""
    return views.transpose() if order == "columns" else unwind(views) if order == "serpentine" else views


def estimate(views: Views, layout: Layout) -> OrderEstimate:
    """Estimates the order of `views` after the changes that `layout` asks for. Reversed rows are put right before."""
    found = _estimate_own(views)
    if is_automatic(layout):
        return found
    views = reorient(unwind(views) if found.is_serpentine else views, layout)
    asked = _estimate_own(views)
    return found if asked.is_serpentine else replace(asked, is_serpentine=found.is_serpentine)


def settle_order(views: Views, layout: Layout, *, corrects: bool = True) -> Views:
    """Puts the light field in the order that `layout` asks for; with `order` columns it is transposed.

    If `layout` asks for nothing and `corrects` is set, a light field that is certainly in a wrong order is put right,
    with a note. Otherwise a note names the options that would do so.
    """
    views = take_order(views, layout.order)
    if layout.order in ASKED:
        return note_asked(reorient(views, layout), layout)
    found = estimate(views, layout)
    views = reorient(views, layout)
    if found.is_wrong and corrects and is_automatic(layout):
        note = f"order: {describe_correction(found)}; order given keeps the order as it was"
        return replace(correct(views, found), notes=(*views.notes, note), is_ordered=True)
    return add_note(views, found, layout)


def reorient(views: Views, layout: Layout) -> Views:
    """Returns the views transposed and then flipped as `layout` asks: their files count an axis from the other end than
    their format does.

    So the depth sense stays that of the format, or is that of `layout`, and a flip of both axes inverts depth.
    """
    found = (views.transpose() if layout.transpose else views).flip(layout.flip)
    return replace(found, depth_sense=layout.depth_sense or views.depth_sense)


def correct(views: Views, found: OrderEstimate) -> Views:
    """Puts views that are in the order `found` into the right one."""
    return _replace_grid(views, found.put_right(_find_grid(views)))


def _find_grid(views: Views) -> NDArray[Any]:
    """Returns the views, or their files, by row and column."""
    return views.files if isinstance(views, ViewFiles) else views.views


def _estimate_own(views: Views) -> OrderEstimate:
    """Estimates the order of the views as they are."""
    return estimate_order(views if isinstance(views, ViewFiles) else views.views)


def _replace_grid(views: Views, grid: NDArray[Any]) -> Views:
    return replace(views, files=grid) if isinstance(views, ViewFiles) else replace(views, views=grid)


def describe_correction(found: OrderEstimate) -> str:
    """Describes what `correct` does, and why. If one axis is reversed, it also names the alternative."""
    done = {
        "as given": "",
        "reversed along one axis": "rows of views are taken from the bottom up",
        "transposed": "the first index is taken as the column",
        "transposed and reversed along one axis": "the first index is taken as the column, the second as the row from "
        "the bottom up",
    }[found.order]
    done = ", ".join(filter(None, (done, "every other line of views reversed" if found.is_serpentine else "")))
    return f"{done}, which fits {_count_tiles(found)}{describe_other_axis(found)}"


def describe_other_axis(found: OrderEstimate) -> str:
    """Describes what the views may be instead if `correct` reverses the rows; empty otherwise.

    The pictures show that one axis is reversed, and the other reading inverts depth.
    """
    if not found.order.endswith("axis"):
        return ""
    return (
        f"; columns counted from right to left fit as well, with depth inverted: if near and far are exchanged, "
        f"give {_name_options(found, Layout(), 'u')}"
    )


def note_asked(views: Views, layout: Layout) -> Views:
    """Returns the views in the order that `layout` asks for, one of `ASKED`.

    A note is added if the pictures certainly show that it is wrong. With `given` they aren't looked at.
    """
    if layout.order == "given":
        return replace(views, is_ordered=True)
    found = _estimate_own(views)
    if not found.is_wrong:
        return replace(views, is_ordered=True)
    note = (
        f"order: with order {layout.order} the views seem to be {found}, as {_count_tiles(found)} show; without it the "
        "pictures decide"
    )
    return replace(views, notes=(*views.notes, note), is_ordered=True)


def add_note(views: Views, found: OrderEstimate, layout: Layout) -> Views:
    """Returns the views as they are. If they may be wrong, a note names the options that would put them right, if there
    are any.
    """
    if contradiction := found.describe_contradiction():
        return replace(views, notes=(*views.notes, contradiction), is_ordered=True)
    if not found.is_likely or str(found) == "as given":
        return replace(views, is_ordered=True)
    verb = "seem to be" if found.is_wrong else "may be"
    options = _name_options(found, layout)
    if found.order.endswith("axis"):
        options += f", or {_name_options(found, layout, 'u')} with depth inverted,"
    note = (
        f"order: the views {verb} {found}, as {_count_tiles(found)} show; they are left as they are: "
        f"{options} would put them right, order given keeps them without this note"
    )
    return replace(views, notes=(*views.notes, note), is_ordered=not found.is_wrong)


def _count_tiles(found: OrderEstimate) -> str:
    return f"{found.votes} of {found.of} textured tiles"


def _name_options(found: OrderEstimate, layout: Layout, axis: Literal["v", "u"] = "v") -> str:
    """Names the options that do what `layout` asks for and then put right views that are in the order `found`.

    If one axis is reversed, they reverse `axis`.
    """
    axes = [each in layout.flip for each in ("v", "u")] if layout.flip != "none" else [False, False]
    is_transposed = layout.transpose
    if found.order.startswith("transposed"):
        axes.reverse()
        is_transposed = not is_transposed
    axes["vu".index(axis)] ^= found.order.endswith("axis")
    flip = "".join(each for each, is_reversed in zip("uv", axes[::-1], strict=True) if is_reversed)
    options = [*(["order serpentine"] if found.is_serpentine else []), *(["transpose"] if is_transposed else [])]
    options += [f"flip {flip}"] if flip else []
    if not (is_transposed or flip) and not is_automatic(layout):
        options.append("no flip and no transpose")
    return " and ".join(options)
