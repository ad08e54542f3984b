"""Reads a picture that holds all views: an elemental image array, or a mosaic of views."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, cast

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures
from ciir.renderer.readers.eia.advice import (
    advise_quilt,
    describe_fitting,
    describe_missing,
    note_exchanged,
    note_other_views,
    note_period,
    note_raw,
)
from ciir.renderer.readers.eia.period import Periods
from ciir.renderer.readers.layout import TEXT, Layout
from ciir.renderer.readers.metadata.colour_profiles import note_profile
from ciir.renderer.readers.picture_sizes import find_format, read_size

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.pictures import Pixels

    Pair = tuple[int, int]


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads the picture in `data` like `read_pixels`; also raises like `pictures.decode`.

    If we wrote the picture as a PNG, its text states how its views lie in it, and `layout` may leave that open. A note
    is added if another pickup is given.

    If `layout.restores_jpeg`, the rounding of an elemental image array that is a JPEG is undone in part
    (`jpeg_rounding`), with a note. Another note names a colour profile that is not sRGB.
    """
    picture = pictures.decode(data, name=name, max_pixels=limits.pixels)
    layout = complete_layout(layout, data)
    entry = find_format(data)
    is_jpeg = entry is not None and entry.name == "JPEG"
    found = read_pixels(picture, name=name, layout=layout, jpeg=data if is_jpeg else b"")
    notes = (*note_profile(data, name), *pictures.note_samples(data))
    own = complete_layout(Layout(), data)
    if own.arrangement == "eia" and layout.pickup not in (None, own.pickup):
        notes = (*notes, f"pickup: the file's own text says {own.pickup}; it is read as {layout.pickup}, as given")
    return replace(found, notes=(*found.notes, *notes))


def complete_layout(layout: Layout, data: bytes) -> Layout:
    """Returns `layout`, completed by the layout that the picture in `data` was written with."""
    entry = find_format(data)
    if entry is None or entry.name != "PNG":
        return layout
    from ciir.renderer.readers import png  # it imports Pillow

    text, size = png.find_text(data, TEXT), read_size(entry, data)
    return layout if text is None or size is None else layout.complete(text, size)


def read_pixels(picture: Pixels, *, name: str, layout: Layout, jpeg: bytes = b"") -> LightField:
    """Reads the light field in `picture`, `(H, W, C)`, without its margins `layout.crop`.

    - An elemental image array: `layout.lenses` elemental images, or elemental images of `layout.pixels`.
    - A mosaic: `layout.pixels` rows and columns of views side by side, or views of `layout.lenses` pixels; the upper
      left one is view (0, 0). Its depth sense is that of cameras.

    With the arrangement `auto` a picture is read as a mosaic if its period certainly is that of one, with a note.
    Another note is added if the picture shows other numbers than the given ones.

    `jpeg`: the file, if it is a JPEG. If `layout.restores_jpeg`, its rounding is undone in part, provided that it is an
    elemental image array without margins whose numbers no note questions.

    Raises `InvalidOption` if both numbers are missing or don't fit the picture, and lists those that would.
    """
    picture = _crop(picture, layout.crop)
    periods = Periods(picture)
    if layout.lenses is None and layout.pixels is None:
        raise InvalidOption(f"{name}: {describe_missing(periods, picture, layout.arrangement)}")
    rows, cols = _count_lenses(picture, layout, periods)
    grid = picture.shape[0] // rows, picture.shape[1] // cols
    is_open = layout.arrangement == "auto"
    note = note_exchanged(periods, (rows, cols), grid) if is_open else ""
    seen = periods.find_arrangement(grid) if is_open and not note else None
    if layout.arrangement == "mosaic" or (seen == "mosaic" and layout.pickup != "optical"):
        return _read_mosaic(picture, grid, periods, is_sure=not is_open)
    if is_open:
        note = note or note_raw(picture, grid) or note_period(periods, grid, fits=seen is not None)
    notes: tuple[str, ...] = (note,) if note else ()
    is_jpeg = False
    if jpeg and layout.restores_jpeg and not note:
        picture, notes = _restore(jpeg, picture, grid)
        is_jpeg = bool(notes)
    light_field = LightField.from_eia(picture, rows=rows, cols=cols, pickup=layout.pickup or "virtual")
    return replace(light_field, notes=notes, is_jpeg=is_jpeg)


def _restore(data: bytes, picture: Pixels, lens: Pair) -> tuple[Pixels, tuple[str, ...]]:
    """Returns the picture in a JPEG with its rounding undone in part, and a note.

    The picture is returned as it is, without a note, if that changes nothing, or if its brightness isn't stored as
    `picture` shows it.
    """
    from ciir.renderer.readers import jpeg  # it imports Pillow
    from ciir.renderer.readers.eia import jpeg_rounding

    luma = jpeg.decode_luma(data)
    if luma is None or luma.pixels.shape != picture.shape[:2]:  # with margins cut
        return picture, ()
    restored = jpeg_rounding.restore(cast("NDArray[np.uint8]", picture), luma, lens)
    if not restored.changed:
        return picture, ()
    share = 100 * restored.changed / luma.pixels.size
    note = (
        f"the array is a JPEG: {'less than 1' if share < 1 else round(share)} % of its pixels were changed, by at most "
        f"{restored.most} of 255 levels, to undo part of the file's rounding, so that brightness changes more "
        "smoothly from view to view; convert it to PNG to upscale it as decoded"
    )
    return restored.pixels, (note,)


def _crop(picture: Pixels, margins: tuple[int, int, int, int]) -> Pixels:
    top, left, bottom, right = margins
    height, width = picture.shape[:2]
    if top + bottom >= height or left + right >= width:
        raise InvalidOption(
            f"crop: {top},{left},{bottom},{right} leaves nothing of the picture of {height}x{width} pixels (rows x "
            "columns); give the margins TOP,LEFT,BOTTOM,RIGHT in pixels"
        )
    return picture[top : height - bottom, left : width - right]


def _read_mosaic(mosaic: Pixels, grid: Pair, periods: Periods, *, is_sure: bool) -> LightField:
    height, width, channels = mosaic.shape
    view = height // grid[0], width // grid[1]
    tiles = mosaic.reshape(grid[0], view[0], grid[1], view[1], channels)  # (v, y, u, x, c)
    quilt = advise_quilt(view, grid)
    note = (
        f"arrangement: the picture repeats about every {view[0]}x{view[1]} pixels, so it is read as a mosaic of "
        f"{grid[0]}x{grid[1]} views; {f'{quilt}; ' if quilt else ''}if it is an elemental image array, give "
        "arrangement eia"
    )
    note = note_other_views(periods, view, grid) or ("" if is_sure else note)
    return LightField(tiles.swapaxes(1, 2), (note,) if note else (), depth_sense="cameras")


def _count_lenses(eia: Pixels, layout: Layout, periods: Periods) -> Pair:
    """Returns the rows and columns of lenses, or of pixels of a view for a mosaic."""
    height, width = eia.shape[:2]
    described = f"the picture of {height}x{width} pixels (rows x columns)"
    for option, given in (("pixels", layout.pixels), ("lenses", layout.lenses)):
        if given is not None and (min(given) < 1 or height % given[0] or width % given[1]):
            found = describe_fitting(periods, eia, layout, given)
            raise InvalidOption(f"{option}: {given[0]}x{given[1]} does not divide {described}; {found}")
    counted = None if layout.pixels is None else (height // layout.pixels[0], width // layout.pixels[1])
    lenses = layout.lenses or counted
    assert lenses is not None  # noqa: S101 - `read_pixels` has checked that one of the options is given
    if counted not in (None, lenses):
        raise InvalidOption(
            f"lenses, pixels: {lenses[0]}x{lenses[1]} lenses of {height // counted[0]}x{width // counted[1]} pixels do "
            f"not make {described}; give one of the two options alone"
        )
    return lenses
