"""Finds out what a picture may be: an elemental image array, a mosaic, or a raw lenslet picture with its grid."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption, Unreadable
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures
from ciir.renderer.readers.eia.advice import SAME_PITCH, USUAL_PIXELS
from ciir.renderer.readers.eia.period import Periods
from ciir.renderer.readers.eia.reader import complete_layout
from ciir.renderer.readers.inputs import read_array_picture
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.lenslet.calibration import detect_grid
from ciir.renderer.readers.lenslet.grid import Known
from ciir.renderer.readers.lenslet.reader import find_grid
from ciir.renderer.readers.lenslet.resampling import fit_pixels
from ciir.renderer.readers.registry import ARRAY_PICTURE, LYTRO, LYTRO_RAW
from ciir.service.pipeline.options import write_texts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.readers.lenslet.calibration import Calibration
    from ciir.renderer.readers.lenslet.grid import LensGrid
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.readers.registry import PictureFormat
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Input

    Candidate = dict[str, Any]


def describe_picture(given: Input, format_: PictureFormat, key: str, options: Options) -> Report:
    """Returns the report on the picture `key`, which may be an array, without timings. Raises `InputError`."""
    bundle = given.bundle
    assert bundle is not None  # noqa: S101 - the key names one of its files
    data = bundle.files[key]
    notes: tuple[str, ...] = ()
    if format_ is ARRAY_PICTURE:
        picture, notes = read_array_picture(bundle, key)
    else:
        picture = pictures.decode(data, name=given.name, max_pixels=given.limits.pixels)
    own = complete_layout(Layout(), data)
    candidates = [_describe_own(own)] if own.pixels else _find_candidates(bundle, format_, key, picture, options)
    return {
        "kind": candidates[0]["kind"] if candidates else "picture",
        "input": given.describe(LightField(picture[None, None])),
        "candidates": candidates,
        "notes": [*notes],
    }


def _describe_own(layout: Layout) -> Candidate:
    """Describes what a picture states about itself.

    Options leave out what is read from the file anyway, such as the pickup.
    """
    given = {"arrangement": "mosaic"} if layout.arrangement == "mosaic" else {}
    options = write_texts(given | {"pixels": layout.pixels})
    return {"kind": layout.arrangement, "options": options, "lenses": layout.lenses, "pixels": layout.pixels}


def _find_candidates(
    bundle: Bundle, format_: PictureFormat, key: str, picture: Pixels, options: Options
) -> list[Candidate]:
    """Lists what the picture `key` may be, the likeliest first. Raises `InputError`."""
    periods = Periods(picture)
    sizes = periods.rank_sizes()
    is_lytro = format_ in (LYTRO, LYTRO_RAW)
    is_raw = options.known_grid is not None or is_lytro or bool(bundle.find_frames(key))
    candidates = []
    if is_raw or detect_grid(picture, sizes[0][0] if sizes else USUAL_PIXELS) is not None:
        try:
            grid = find_grid(bundle, key, options.known_grid or Known())
        except (Unreadable, InvalidOption):  # the whole picture shows no grid
            if is_raw:
                raise
        else:
            is_raw = is_raw or not _is_regular(grid.grid, sizes)
            candidates.append(_describe_raw(grid, is_lytro=is_lytro))
    if not is_raw:
        candidates = [*_list_arrangements(periods, picture.shape, sizes), *candidates]
    return candidates


def _is_regular(grid: LensGrid, sizes: Sequence[tuple[int, int]]) -> bool:
    """Checks whether the lenses match elemental images of a whole number of pixels."""
    return grid.shape == "square" and any(abs(grid.pitch / side - 1) < SAME_PITCH for size in sizes for side in size)


def _list_arrangements(periods: Periods, shape: tuple[int, ...], sizes: Sequence[tuple[int, int]]) -> list[Candidate]:
    """Lists what may repeat with each of `sizes`: views of a mosaic, if these are larger, and elemental images."""
    found: list[Candidate] = []
    for size in sizes:
        others = shape[0] // size[0], shape[1] // size[1]
        if periods.is_mosaic(size):
            texts = write_texts({"arrangement": "mosaic", "pixels": others})
            found.append({"kind": "mosaic", "options": texts, "lenses": size, "pixels": others})
        found.append({"kind": "eia", "options": write_texts({"pixels": size}), "lenses": others, "pixels": size})
    return found


def _describe_raw(calibration: Calibration, *, is_lytro: bool) -> Candidate:
    grid = asdict(calibration.known)
    texts = {  # as exact as the picture shows them
        "lens_pitch": round(grid["pitch"], 5),
        "lens_offset": tuple(round(each, 3) for each in grid["offset"]),
        "lens_rotation": round(grid["rotation"], 4),
        "lens_grid": grid["shape"],
    }
    fits = fit_pixels(calibration.grid)
    return {
        "kind": "raw",
        "options": {} if is_lytro else write_texts(texts),
        "pixels": (fits, fits),
        "lens_grid": grid,
    }
