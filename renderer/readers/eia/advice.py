"""Advice on a picture of all views: notes on numbers that it contradicts, and the numbers that would fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.renderer.displays.devices import find_aspect, find_layout
from ciir.renderer.displays.quilt import MAX_ASPECT, MAX_TILES, QuiltLayout
from ciir.renderer.readers.eia.period import is_about, is_near

if TYPE_CHECKING:
    from ciir.renderer.readers.eia.period import Periods
    from ciir.renderer.readers.layout import Arrangement, Layout
    from ciir.renderer.readers.pictures import Pixels

    Pair = tuple[int, int]

SAME_PITCH = 0.003
"""A share of the pitch: the last of 200 lenses would be off by 0.6 of its pixels."""
USUAL_PIXELS = 15
"""Pixels along each side of an elemental image; it determines how many lenses are looked at."""
PLAIN = "an ordinary photo is upscaled with `ciir upscale`"
RAW = "give lens_pitch auto for a raw lenslet picture, whose lenses aren't a whole number of pixels wide"


def describe_missing(periods: Periods, picture: Pixels, arrangement: Arrangement) -> str:
    """Says what to give if neither lenses nor pixels were given."""
    mosaic = _describe_mosaic(periods) if arrangement != "eia" else ""
    if mosaic and arrangement == "mosaic":
        return mosaic
    if mosaic:
        view = periods.rank_sizes()[0]
        quilt = advise_quilt(view, (periods.size[0] // view[0], periods.size[1] // view[1]))
        seen = _describe_mosaic(periods, f"{quilt}; otherwise " if quilt else "")
        return f"{seen}; if it is an elemental image array, give arrangement eia and pixels {view[0]}x{view[1]}"
    if arrangement == "mosaic":
        seen = _describe_period(periods, arrangement)
        return f"a mosaic is read by its rows and columns of views; give them, as in pixels 9x9{seen}"
    wanted = "give the number of lenses, as in lenses 50x50 (rows x columns), or of pixels of each, as in pixels 15x15"
    found = _describe_lenses(periods, picture, USUAL_PIXELS, wanted)
    plain = f"; {PLAIN}" if found == wanted else ""
    layout = find_layout(periods.size) if arrangement == "auto" else None
    quilt = _name_quilt(layout) if layout else ""
    start = f"{quilt}; any other" if quilt and quilt not in found else "a"
    return f"{start} picture is read as an elemental image array; {found}{'' if RAW in found else f'; {RAW}'}{plain}"


def describe_fitting(periods: Periods, picture: Pixels, layout: Layout, given: Pair) -> str:
    """Returns the numbers that divide the picture if `given` don't, and the option for margins that these may leave."""
    size = picture.shape[:2]
    is_period = given == layout.pixels == periods.find() and layout.arrangement != "mosaic"
    if is_period and not _find_other_lenses(picture, max(given), given):
        repeats = f"but it repeats every {given[0]}x{given[1]} pixels, so it has margins"
        return f"{repeats}; give them as crop TOP,LEFT,BOTTOM,RIGHT"
    fitting = [_find_nearest_divisor(count, length) for count, length in zip(given, size, strict=True)]
    advice = f"the nearest that does is {fitting[0]}x{fitting[1]}"
    if all(count and length % count == 0 for count, length in zip(given[::-1], size, strict=True)):
        advice = f"{given[1]}x{given[0]} (rows x columns) does"
    if all(0 < count <= length for count, length in zip(given, size, strict=True)):
        advice += "; give margins on all four sides as crop TOP,LEFT,BOTTOM,RIGHT: the size alone doesn't reveal them"
    if layout.arrangement == "mosaic" or _describe_mosaic(periods):
        return advice + _describe_period(periods, layout.arrangement)
    return _describe_lenses(periods, picture, max(layout.pixels or (USUAL_PIXELS,)), advice)


def note_exchanged(periods: Periods, lenses: Pair, grid: Pair) -> str:
    """Returns a note if the picture's elemental images have about as many pixels as the given `lenses`; else an empty
    text.
    """
    found = periods.find() if lenses[0] < grid[0] and lenses[1] < grid[1] else None
    if found is None or not all(map(is_near, found, lenses)):
        return ""
    given = f"{lenses[0]}x{lenses[1]}"
    return (
        f"lenses: read as {given} lenses of {grid[0]}x{grid[1]} pixels, but the picture repeats about every "
        f"{found[0]}x{found[1]} pixels; if {given} are the pixels of an elemental image, give pixels {given}"
    )


def note_raw(eia: Pixels, grid: Pair) -> str:
    """Returns a note if the picture's lenses clearly aren't a grid of elemental images of `grid` pixels; else an empty
    text.
    """
    lenses = _find_other_lenses(eia, max(grid), grid)
    if not lenses:
        return ""
    return (
        f"pixels: read as elemental images of {grid[0]}x{grid[1]} pixels, but {lenses}, so views mix places under "
        "the lenses; lens_pitch auto reads it as a raw lenslet picture"
    )


def note_period(periods: Periods, grid: Pair, *, fits: bool) -> str:
    """Returns a note if the picture shows elemental images of another size than `grid`, or none; else an empty text.

    `fits`: whether it repeats after `grid` pixels. It also does so if these are several elemental images.
    """
    if fits and periods.is_mosaic(grid):
        counts = _divide(periods.size, grid)
        return (
            f"arrangement: read as {counts} elemental images of {grid[0]}x{grid[1]} pixels, which may be views: if "
            f"they are, give arrangement mosaic and pixels {counts}"
        )
    if fits and not periods.repeats_within(grid):
        return ""
    seen = _describe_period(periods, "auto").removeprefix("; ")
    plain = "" if seen else f"; {PLAIN}"
    seen = f"but {seen}" if seen else "which the picture doesn't show clearly"
    return (
        f"arrangement: read as elemental images of {grid[0]}x{grid[1]} pixels, {seen}; give lenses and pixels "
        f"that match it, or arrangement mosaic for views side by side{plain}"
    )


def note_other_views(periods: Periods, view: Pair, grid: Pair) -> str:
    """Returns a note if a mosaic, read as `grid` views of `view` pixels, certainly is one of other views, or repeats
    like elemental images of `grid` pixels; else an empty text.
    """
    found = periods.find()
    if found is not None and all(map(is_near, found, grid)):
        return (
            f"arrangement: read as a mosaic of {grid[0]}x{grid[1]} views, but the picture repeats about every "
            f"{found[0]}x{found[1]} pixels, as elemental images of {grid[0]}x{grid[1]} do; arrangement eia "
            "reads it that way"
        )
    seen = _describe_mosaic(periods)
    if not seen or view == periods.rank_sizes()[0]:
        return ""
    return f"pixels: read as a mosaic of {grid[0]}x{grid[1]} views of {view[0]}x{view[1]} pixels, but {seen}"


def advise_quilt(view: Pair, grid: Pair) -> str:
    """Returns advice on the name that a quilt of `grid` views of `view` pixels needs: without it a quilt is read as a
    mosaic. The aspect in the name is that of a device with such quilts, or else that of square pixels.

    The text is empty if no quilt is like that: views with no more pixels than there are views are elemental images of
    many lenses.
    """
    aspect = view[1] / view[0]
    if min(view) <= max(grid) or max(grid) > MAX_TILES or not 1 / MAX_ASPECT <= aspect <= MAX_ASPECT:
        return ""
    return _name_quilt(QuiltLayout(grid[1], grid[0], find_aspect(grid, view) or aspect))


def _name_quilt(layout: QuiltLayout) -> str:
    return f"if it is a quilt, name it NAME{layout.suffix}.png, or put its NAME.png.json next to it"


def _describe_period(periods: Periods, arrangement: Arrangement) -> str:
    """Describes the picture's own period, for a message; empty if it shows none.

    Parallax changes the period a little, so a period that doesn't divide the picture may be that of another size.
    """
    mosaic = _describe_mosaic(periods)
    if mosaic:
        return f"; {mosaic}"
    found = periods.find()
    if found is None:
        return ""
    advice = f"; the picture repeats about every {found[0]}x{found[1]} pixels"
    nearest = [_find_nearest_divisor(each, length) for each, length in zip(found, periods.size, strict=True)]
    counts = [length // each for each, length in zip(nearest, periods.size, strict=True)]
    if arrangement == "mosaic":
        return f"{advice}, as {counts[0]}x{counts[1]} views would" if all(map(is_near, found, nearest)) else advice
    fitting = [size for size in periods.rank_sizes() if all(map(is_about, found, size))]
    divides = nearest == [*found]
    if divides and found not in fitting:  # squares are ranked first
        fitting = [found, *fitting]
    own = " or ".join("{}x{}".format(*size) for size in fitting or [found])
    if divides:
        views = "{}x{}".format(*counts)
        advice += f", the size of an elemental image (pixels {own}) or of a view of a mosaic (pixels {views})"
        quilt = advise_quilt(found, (counts[0], counts[1]))
        return f"{advice}; {quilt}" if quilt else advice
    if fitting:
        advice += f", which doesn't divide it as elemental images would (pixels {own})"
    return f"{advice}; {RAW}"


def _describe_mosaic(periods: Periods, first: str = "") -> str:
    """Describes the period of a picture that certainly is a mosaic, and after the advice `first` the option that reads
    it; empty for any other picture.
    """
    view = next(iter(periods.rank_sizes()), None)
    if view is None or not periods.is_mosaic(view):
        return ""
    counts = _divide(periods.size, view)
    return (
        f"the picture repeats every {view[0]}x{view[1]} pixels, as a mosaic of {counts} views (rows x columns) does; "
        f"{first}give pixels {counts}"
    )


def _divide(size: Pair, part: Pair) -> str:
    """Returns the number of parts in the picture, as text."""
    return f"{size[0] // part[0]}x{size[1] // part[1]}"


def _describe_lenses(periods: Periods, picture: Pixels, about: int, wanted: str) -> str:
    """Says what to give: `lens_pitch` for a raw lenslet picture, else `wanted`, with the period of the picture."""
    found = _find_other_lenses(picture, about, None)
    return f"{found}: {RAW}" if found else wanted + _describe_period(periods, "auto")


def _find_other_lenses(picture: Pixels, about: int, pixels: Pair | None) -> str:
    """Describes the lenses if the picture clearly shows some of about `about` pixels that don't fit elemental images of
    `pixels`; else an empty text.

    If `pixels` is None, lenses don't fit if they aren't a whole number of pixels wide.
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


def _find_nearest_divisor(count: int, length: int) -> int:
    return min((n for n in range(1, length + 1) if length % n == 0), key=lambda n: (abs(n - count), n))
