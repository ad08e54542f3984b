"""Reads a picture that holds all views: an elemental image array, or a mosaic of views."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures
from ciir.renderer.readers.eia.period import Periods

if TYPE_CHECKING:
    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout
    from ciir.renderer.readers.pictures import Pixels

    Pair = tuple[int, int]

SAME_PITCH = 0.003
"""Of the pitch: of 200 lenses the last would be off by 0.6 of its pixels."""
USUAL_PIXELS = 15
"""Along each side of an elemental image; how many lenses are looked at follows from it."""
RAW = "give lens_pitch auto for a raw lenslet picture, whose lenses have no whole number of pixels"


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """The light field in the picture `data`, without its margins `layout.crop`.

    - An elemental image array: `layout.lenses` elemental images, or elemental images of `layout.pixels`.
    - A mosaic: `layout.pixels` rows and columns of views side by side, or views of `layout.lenses` pixels; the upper
      left one is view (0, 0). Its depth sense is that of cameras.

    With the arrangement `auto` a picture is a mosaic where its period certainly is that of one, with a note.

    Raises `InvalidOption` where both numbers are missing or don't fit the picture, with those that would, and as
    `pictures.decode`.
    """
    eia = _crop(pictures.decode(data, name=name, max_pixels=limits.pixels), layout.crop)
    periods = Periods(eia)
    if layout.lenses is None and layout.pixels is None:
        wanted = (
            "give the number of lenses, as in lenses 50x50 (rows x columns), or of pixels of each, as in pixels 15x15"
        )
        found = _describe_lenses(periods, eia, layout, wanted)
        raise InvalidOption(
            f"{name}: a picture is read as an elemental image array; {found}{'' if RAW in found else f'; {RAW}'}"
        )
    rows, cols = _count_lenses(eia, layout, periods)
    grid = eia.shape[0] // rows, eia.shape[1] // cols
    found = layout.arrangement
    exchanged = _describe_exchanged(periods, (rows, cols), grid) if found == "auto" else ()
    if found == "auto" and layout.pickup == "virtual" and not exchanged:
        found = periods.find_arrangement(grid) or "auto"
    if found == "mosaic":
        return _read_mosaic(eia, grid, is_sure=layout.arrangement == "mosaic")
    light_field = LightField.from_eia(eia, rows=rows, cols=cols, pickup=layout.pickup)
    if layout.arrangement == "auto":
        notes = (
            exchanged or _describe_raw(eia, grid) or (_describe_unclear(periods, eia, grid) if found == "auto" else ())
        )
        light_field = replace(light_field, notes=notes)
    return light_field


def _describe_exchanged(periods: Periods, lenses: Pair, grid: Pair) -> tuple[str, ...]:
    """A note on a picture whose elemental images have about as many pixels as `lenses`, which were given."""
    found = periods.find() if lenses[0] < grid[0] and lenses[1] < grid[1] else None
    if found is None or any(abs(each - count) > 1 + count // 16 for each, count in zip(found, lenses, strict=True)):
        return ()
    given = f"{lenses[0]}x{lenses[1]}"
    note = (
        f"lenses: read as {given} lenses of {grid[0]}x{grid[1]} pixels, but the picture repeats about every "
        f"{found[0]}x{found[1]} pixels; if {given} are the pixels of an elemental image, give pixels {given}"
    )
    return (note,)


def _describe_raw(eia: Pixels, grid: Pair) -> tuple[str, ...]:
    """A note on a picture whose lenses clearly are no grid of elemental images of `grid` pixels."""
    lenses = _find_other_lenses(eia, max(grid), grid)
    if not lenses:
        return ()
    note = (
        f"pixels: read as elemental images of {grid[0]}x{grid[1]} pixels, but {lenses}, so that views mix places under "
        "the lenses; lens_pitch auto reads it as a raw lenslet picture"
    )
    return (note,)


def _find_other_lenses(picture: Pixels, about: int, pixels: Pair | None) -> str:
    """What the lenses are, where the picture clearly shows some of `about` so many pixels that have no elemental images
    of `pixels`, or with None of no whole number of pixels.
    """
    from ciir.renderer.readers.lenslet.calibration import detect_grid

    found = detect_grid(picture, about)
    if found is None:
        return ""
    sides = pixels or (max(1, round(found.pitch)),)
    if found.shape == "square" and all(abs(found.pitch / side - 1) < SAME_PITCH for side in sides):
        return ""
    return f"its lenses are {found.pitch:.2f} pixels apart" + (
        " in a hexagonal grid" if found.shape != "square" else ""
    )


def _describe_unclear(periods: Periods, eia: Pixels, grid: Pair) -> tuple[str, ...]:
    """A note on a picture that shows elemental images of another size, or none."""
    if periods.find_arrangement(grid) is not None:
        return ()
    seen = _describe_period(periods, eia).removeprefix("; ")
    seen = f"but {seen}" if seen else "which the picture doesn't show clearly"
    note = (
        f"arrangement: read as elemental images of {grid[0]}x{grid[1]} pixels, {seen}; check lenses and pixels, or "
        "give arrangement mosaic for views side by side"
    )
    return (note,)


def _crop(picture: Pixels, margins: tuple[int, int, int, int]) -> Pixels:
    top, left, bottom, right = margins
    height, width = picture.shape[:2]
    if top + bottom >= height or left + right >= width:
        raise InvalidOption(
            f"crop: {top},{left},{bottom},{right} leaves nothing of the picture of {height}x{width} pixels (rows x "
            "columns); give the margins TOP,LEFT,BOTTOM,RIGHT in pixels"
        )
    return picture[top : height - bottom, left : width - right]


def _read_mosaic(mosaic: Pixels, grid: Pair, *, is_sure: bool) -> LightField:
    height, width, channels = mosaic.shape
    tiles = mosaic.reshape(grid[0], height // grid[0], grid[1], width // grid[1], channels)  # (v, y, u, x, c)
    note = (
        f"arrangement: the picture repeats every {height // grid[0]}x{width // grid[1]} pixels, so it is read as a "
        f"mosaic of {grid[0]}x{grid[1]} views, not as an elemental image array; arrangement eia reads it as one"
    )
    return LightField(tiles.swapaxes(1, 2), () if is_sure else (note,), depth_sense="cameras")


def _count_lenses(eia: Pixels, layout: Layout, periods: Periods) -> Pair:
    """Rows and columns of lenses; of a mosaic, of pixels of a view."""
    height, width = size = eia.shape[:2]
    described = f"the picture of {height}x{width} pixels (rows x columns)"
    for option, given in (("pixels", layout.pixels), ("lenses", layout.lenses)):
        if given is not None and (min(given) < 1 or height % given[0] or width % given[1]):
            found = _describe_lenses(periods, eia, layout, _describe_fitting(given, size))
            raise InvalidOption(f"{option}: {given[0]}x{given[1]} does not divide {described}; {found}")
    counted = None if layout.pixels is None else (height // layout.pixels[0], width // layout.pixels[1])
    lenses = layout.lenses or counted
    assert lenses is not None  # noqa: S101 - `read` has checked that one of the options is given
    if counted not in (None, lenses):
        raise InvalidOption(
            f"lenses, pixels: {lenses[0]}x{lenses[1]} lenses of {height // counted[0]}x{width // counted[1]} pixels do "
            f"not make {described}; give one of the two options alone"
        )
    return lenses


def _describe_fitting(given: Pair, size: Pair) -> str:
    """The nearest numbers that divide the picture, and the option for margins where `given` could leave some."""
    fitting = [_find_nearest_divisor(count, length) for count, length in zip(given, size, strict=True)]
    words = f"the nearest that does is {fitting[0]}x{fitting[1]}"
    if all(0 < count <= length for count, length in zip(given, size, strict=True)):
        words += "; give margins on all four sides as crop TOP,LEFT,BOTTOM,RIGHT: the size alone doesn't tell them"
    return words


def _find_nearest_divisor(count: int, length: int) -> int:
    return min((n for n in range(1, length + 1) if length % n == 0), key=lambda n: (abs(n - count), n))


def _describe_lenses(periods: Periods, picture: Pixels, layout: Layout, wanted: str) -> str:
    """What to give: `lens_pitch` for a raw lenslet picture, else what is `wanted`, with the period of the picture."""
    found = _find_other_lenses(picture, max(layout.pixels or (USUAL_PIXELS,)), None)
    return f"{found}: {RAW}" if found else wanted + _describe_period(periods, picture)


def _describe_period(periods: Periods, picture: Pixels) -> str:
    """What the picture's own period would be, for a message; empty where it shows none.

    Parallax changes the period a little, so that one that doesn't divide the picture may be that of another size.
    """
    found = periods.find()
    if found is None:
        return ""
    size = picture.shape[:2]
    words = f"; the picture repeats about every {found[0]}x{found[1]} pixels"
    nearest = [_find_nearest_divisor(each, length) for each, length in zip(found, size, strict=True)]
    if nearest == [*found]:
        counts = [length // each for each, length in zip(found, size, strict=True)]
        return f"{words}, the size of an elemental image, or of a view of a mosaic (pixels {counts[0]}x{counts[1]})"
    if all(abs(divisor - each) <= 1 + each // 16 for divisor, each in zip(nearest, found, strict=True)):
        words += f", which doesn't divide it as elemental images of {nearest[0]}x{nearest[1]} would"
    return f"{words}; {RAW}"
