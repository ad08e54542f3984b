"""Puts views in the order that was asked for, or that the pictures show."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.view_set.view_files import ViewFiles
from ciir.renderer.view_order import estimate_order

if TYPE_CHECKING:
    from ciir.renderer.readers.layout import Layout
    from ciir.renderer.view_order import Order, OrderEstimate

Views = TypeVar("Views", LightField, ViewFiles)


def is_automatic(layout: Layout) -> bool:
    """Whether the pictures may decide the order: nothing was asked for."""
    return layout.order == "auto" and layout.flip == "none" and not layout.transpose


def settle_order(views: Views, layout: Layout, *, corrects: bool = True) -> Views:
    """The light field in the order that `layout` asks for, with `order` columns transposed. Without any such wish, and
    where `corrects`, one that is certainly in a wrong order is put right, with a note; else a note names the options
    that would.
    """
    if layout.order == "columns":
        views = views.transpose()
    views = reorient(views, layout)
    if layout.order == "given":
        return replace(views, is_ordered=True)
    found = estimate_order(views if isinstance(views, ViewFiles) else views.views)
    if found.is_wrong and corrects and is_automatic(layout):
        note = f"order: {describe_correction(found)}; order given keeps the order as it was"
        return replace(correct(views, found.order), notes=(*views.notes, note), is_ordered=True)
    return add_note(views, found, layout)


def reorient(views: Views, layout: Layout) -> Views:
    """The views transposed and then flipped as `layout` asks for."""
    return (views.transpose() if layout.transpose else views).flip(layout.flip)


def correct(views: Views, order: Order) -> Views:
    """Views that are in `order`, in the right one. Where one axis is reversed, the pictures don't show which: rows."""
    turned = views.transpose() if order.startswith("transposed") else views
    return turned.flip("v") if order.endswith("axis") else turned


def describe_correction(found: OrderEstimate) -> str:
    """What `correct` does, and why."""
    done = {
        "reversed along one axis": "rows of views are taken from the bottom up",
        "transposed": "the first index is taken as the column",
        "transposed and reversed along one axis": "the first index is taken as the column, the second as the row from "
        "the bottom up",
    }[found.order]
    return f"{done}, which fits {_count_tiles(found)}"


def add_note(views: Views, found: OrderEstimate, layout: Layout) -> Views:
    """The views as they are; with a note on the options that would put them right, where they may be wrong."""
    if not found.is_likely or found.order == "as given":
        return replace(views, is_ordered=True)
    verb = "seem to be" if found.is_wrong else "may be"
    note = (
        f"order: the views {verb} {found.order}, as {_count_tiles(found)} show; they are left as they are: "
        f"{_name_options(found.order, layout)} would put them right, order given keeps them without this note"
    )
    return replace(views, notes=(*views.notes, note), is_ordered=not found.is_wrong)


def _count_tiles(found: OrderEstimate) -> str:
    return f"{found.votes} of {found.of} textured tiles"


def _name_options(order: Order, layout: Layout) -> str:
    """The options that do what `layout` asks for and then put views that are in `order` right."""
    axes = [axis in layout.flip for axis in ("v", "u")] if layout.flip != "none" else [False, False]
    is_transposed = layout.transpose
    if order.startswith("transposed"):
        axes.reverse()
        is_transposed = not is_transposed
    axes[0] ^= order.endswith("axis")
    flip = "".join(axis for axis, is_reversed in zip("uv", axes[::-1], strict=True) if is_reversed)
    options = [*(["transpose"] if is_transposed else []), *([f"flip {flip}"] if flip else [])]
    return " and ".join(options) or "no flip and no transpose"
