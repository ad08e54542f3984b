"""Reads a quilt as a light field of one row of views."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ciir.errors import Unreadable
from ciir.renderer.displays.quilt import QuiltName, parse_json, parse_name, split_quilt
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures
from ciir.renderer.readers.metadata.colour_profiles import note_profile
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from ciir.renderer.displays.quilt import QuiltLayout
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.readers.pictures import Pixels


def find_layout(bundle: Bundle, key: str) -> QuiltLayout | QuiltName | None:
    """Finds the layout of the picture `key` from its name or the file `key.json` next to it; None if it is not a quilt.

    A name doesn't state whether views are inverted, and may lack an aspect. JSON with the same numbers of columns and
    rows supplies both.

    Raises `InvalidOption` if a number is out of range.
    """
    named = parse_name(key)
    if f"{key}.json" not in bundle.files:
        return named
    try:
        beside = parse_json(bundle.files[f"{key}.json"], name=clean_text(f"{key}.json"))
    except Unreadable:  # JSON for something else
        return named
    if named is None:
        return beside
    if (named.cols, named.rows) != (beside.cols, beside.rows):
        return named
    return replace(named.complete(beside.aspect), is_inverted=beside.is_inverted)


def read(bundle: Bundle, key: str, layout: QuiltLayout | QuiltName) -> LightField:
    """Reads the views of the picture `key` like `read_pixels`. A note names a colour profile that is not sRGB.

    Raises what `read_pixels` and decoding raise.
    """
    name = clean_text(bundle.name)
    quilt = pictures.decode(bundle.files[key], name=name, max_pixels=bundle.limits.pixels)
    found = read_pixels(quilt, layout, name=name)
    return replace(found, notes=(*found.notes, *note_profile(bundle.files[key], name)))


def read_pixels(quilt: Pixels, layout: QuiltLayout | QuiltName, *, name: str) -> LightField:
    """Returns the quilt's views, `(1, columns * rows, h, w, c)`, starting with the leftmost camera. Without an aspect,
    pixels are taken as square, with a note.

    Raises `InvalidOption` if the picture is smaller than its layout.
    """
    is_square = layout.aspect is None
    layout = layout.complete(1.0) if isinstance(layout, QuiltName) else layout
    views = split_quilt(quilt, layout, name=name)
    notes = [f"read as a quilt of {layout.cols} columns and {layout.rows} rows of views"]
    if layout.is_inverted:
        notes.append("its JSON says invertViews: the views are put from left to right")
    height, width = views.shape[1:3]
    if is_square:
        notes.append("the name has no aspect: pixels are taken as square")
    elif abs(width / height / layout.aspect - 1) > 1 / min(width, height):
        notes.append(
            f"views of {width}x{height} pixels are shown with the aspect {layout.aspect:.4g}: pixels are not square"
        )
    return LightField(
        views[None],
        notes=tuple(notes),
        is_ordered=True,
        depth_sense="cameras",
        pixel_aspect=1.0 if is_square else layout.aspect * height / width,
    )
