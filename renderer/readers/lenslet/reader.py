"""Reads a raw lenslet picture, with its white and dark frames, as a light field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption, TooLarge, Unreadable
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures
from ciir.renderer.readers.containers import array_pictures
from ciir.renderer.readers.eia.period import Periods
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.lenslet.calibration import Calibration, NoGrid, calibrate, detect_grid
from ciir.renderer.readers.lenslet.drawing import draw_grid
from ciir.renderer.readers.lenslet.frames import divide_by_white, subtract_dark
from ciir.renderer.readers.lenslet.grid import Known
from ciir.renderer.readers.lenslet.resampling import fit_pixels, resample_views
from ciir.renderer.readers.lytro.metadata import find_camera
from ciir.renderer.readers.names import clean_text
from ciir.renderer.readers.registry import ARRAY_PICTURE, ContainerFormat, identify, reported

if TYPE_CHECKING:
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.readers.lytro.metadata import Camera
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import DepthSense

_SAME = 0.01
"""A share of the pitch: a quick look at some lenses has a smaller error."""
_OFF = 0.25
"""In pitches: how far a visible lens may be from where the given offset puts it."""
_WHOLE = 0.003
"""A share of the pitch: a pitch this close to whole pixels may be that of an elemental image array."""
_SETTLED = 0.05
"""In pixels over all lenses: a pitch that is less certain is noted as such."""


@dataclass(frozen=True)
class _Raw:
    picture: Pixels
    """The picture minus its dark frame, divided by its white one; transposed if the grid has columns."""
    calibration: Calibration
    has_white: bool
    is_lytro: bool
    difference: str
    """A note if a quick look finds other lenses than those that were given; empty if they are the same."""
    rounded: tuple[str, ...]
    """A note if the picture is an array of floating-point numbers."""


def read(bundle: Bundle, key: str, layout: Layout, known: Known) -> LightField:
    """Reads the light field of the picture `key`, with `white` and `dark` pictures of the same set as its frames.

    `bundle.keep_grid` receives the picture with its lens grid drawn over it.

    A view has a pixel for each lens, and `layout.pixels` states how many pixels under a lens become views; by default
    as many as every lens has. Views of a Lytro camera count its positions from the left, as Lytro's ESLF does, so their
    depth sense is that of cameras. Raises `InputError`.
    """
    name = clean_text(bundle.name)
    for option in ("lenses", "arrangement", "crop"):
        if getattr(layout, option) != getattr(Layout, option):
            raise InvalidOption(
                f"{option}: this is for elemental image arrays, and lens_pitch says that {name} isn't one; "
                "leave one of them out"
            )
    raw = _load(bundle, key, known)
    grid, in_columns = raw.calibration.grid, raw.calibration.in_columns
    if bundle.keep_grid is not None:
        drawn = draw_grid(raw.picture, grid)
        bundle.keep_grid(drawn.swapaxes(0, 1) if in_columns else drawn)
    fits = fit_pixels(grid)
    pixels = layout.pixels or (fits, fits)
    if max(pixels) > grid.pitch + 1:
        raise InvalidOption(
            f"pixels: {pixels[0]}x{pixels[1]} are more than lenses of {grid.pitch:.2f} pixels have; give at most "
            f"{int(grid.pitch) + 1}x{int(grid.pitch) + 1}"
        )
    height, width, channels = raw.picture.shape
    size = height * width * channels * raw.picture.dtype.itemsize * pixels[0] * pixels[1] / grid.pitch**2 * 4 / 3
    if size > bundle.limits.set_bytes:
        raise TooLarge(
            f"{name}: its views take up to {int(size):,} bytes; at most {bundle.limits.set_bytes:,} are read; "
            "give fewer pixels",
            "set_bytes",
        )
    views = resample_views(raw.picture, grid, pixels[::-1] if in_columns else pixels, pickup=layout.pickup or "virtual")
    if in_columns:
        views = views.transpose(1, 0, 3, 2, 4)
    notes = [_describe_grid(raw.calibration)]
    if raw.is_lytro and raw.calibration.cue is None and known == Known():
        notes = [f"{notes[0]} by the camera's metadata, since the picture shows none; see --show-grid"]
    if raw.difference:
        notes.append(raw.difference)
    if max(pixels) > fits:
        notes.append(f"pixels: lenses have {fits}x{fits} of their own; views beyond these also show their neighbours")
    if not raw.has_white:
        notes.append("views of pixels at the borders of lenses stay dark, because there was no white picture")
    if grid.shape == "hexagonal":
        notes.append(f"the hexagonal grid was resampled to {views.shape[2]}x{views.shape[3]} pixels of a square one")
    notes += raw.rounded
    sense: DepthSense = "cameras" if raw.is_lytro else "lenses"
    return LightField(views, tuple(notes), depth_sense=sense, lens_pitch=grid.pitch)


def find_grid(bundle: Bundle, key: str, known: Known) -> Calibration:
    """Finds the lens grid of the picture `key` in the same way as `read`. Raises `InputError`."""
    return _load(bundle, key, known).calibration


def _load(bundle: Bundle, key: str, known: Known) -> _Raw:
    name = clean_text(bundle.name)
    if isinstance(identify(key, bundle.files[key]), ContainerFormat):
        with reported(name, ARRAY_PICTURE):
            picture, rounded = array_pictures.read(bundle.files[key], name, bundle.limits)
    else:
        picture, rounded = pictures.decode(bundle.files[key], name=name, max_pixels=bundle.limits.pixels), ()
    keys = bundle.find_frames(key)
    frames = {which: _decode_frame(bundle, frame, picture, which, "dark" in keys) for which, frame in keys.items()}
    white, dark = frames.get("white"), frames.get("dark")
    if dark is not None:
        picture = subtract_dark(picture, dark)
        white = None if white is None else subtract_dark(white, dark)
    camera = find_camera(bundle.files[key], name)
    shown = picture if white is None else white
    try:
        calibration = _calibrate(shown, known, camera, name, is_white=white is not None)
    except NoGrid as error:
        if frames or camera is not None:
            raise
        raise Unreadable(f"{error}; {_describe_elemental_images(picture)}") from error
    difference = _describe_difference(shown, known, calibration)
    if white is not None:
        picture = divide_by_white(picture, white)
    if calibration.in_columns:
        picture = picture.swapaxes(0, 1)
    return _Raw(picture, calibration, white is not None, camera is not None, difference, rounded)


def _describe_elemental_images(picture: Pixels) -> str:
    """Says what to give instead for a picture without a lens grid."""
    sizes = " or ".join("{}x{}".format(*size) for size in Periods(picture).rank_sizes())
    seen = f" (by its period {sizes})" if sizes else ""
    return f"if it is an elemental image array, leave lens_pitch out and give lenses or pixels{seen}"


def _describe_difference(picture: Pixels, known: Known, taken: Calibration) -> str:
    """Returns a note if the picture clearly shows lenses with another pitch than the given one, or, with the given
    offset, elsewhere than in `taken`; else an empty text.
    """
    if known.pitch is None and known.offset is None:
        return ""
    found = detect_grid(picture, round(taken.grid.pitch))
    if found is None:
        return ""
    if abs(found.pitch / taken.grid.pitch - 1) >= _SAME:
        return (
            f"lens_pitch: {taken.grid.pitch:g} was given, but lenses {found.pitch:.2f} pixels apart are seen in the "
            "picture; lens_pitch auto finds them"
        )
    if known.offset is None:
        return ""
    way = slice(None, None, -1 if taken.in_columns else 1)
    middle = (np.array(picture.shape[:2]) - 1) / 2
    lens = taken.grid.find_centers(*taken.grid.find_nearest(middle[way]))[way]
    shown = found.find_centers(*found.find_nearest(lens))
    if np.hypot(*(shown - lens)) <= _OFF * taken.grid.pitch:
        return ""
    return (
        f"lens_offset: {known.offset[0]:g},{known.offset[1]:g} puts a lens in the middle of the picture at "
        f"{lens[0]:.2f},{lens[1]:.2f} (y, x), but one is seen at {shown[0]:.2f},{shown[1]:.2f}; leave lens_offset out "
        "to find it"
    )


def _calibrate(picture: Pixels, known: Known, camera: Camera | None, name: str, *, is_white: bool) -> Calibration:
    """Returns the grid that `picture` shows. If it shows none and nothing is known, returns the grid of the `camera`'s
    metadata.
    """
    if camera is None or known != Known():
        return calibrate(picture, known, name=name, is_white=is_white)
    try:
        return calibrate(picture, camera.known, name=name, is_white=is_white)
    except Unreadable:
        if camera.grid is None:
            raise
        return Calibration(camera.grid, in_columns=camera.known.shape == "hexagonal-columns")


def _decode_frame(bundle: Bundle, key: str, picture: Pixels, which: str, has_dark: bool) -> Pixels:
    """Decodes the frame `which` of `picture`.

    A white frame may have another bit depth, because only its ratios count, unless a dark one is subtracted from it. A
    grey frame of a picture in colour counts for all channels.
    """
    frame = pictures.decode(bundle.files[key], name=f"{which} picture", max_pixels=bundle.limits.pixels)
    is_grey = frame.shape == (*picture.shape[:2], 1)
    if not (is_grey or frame.shape == picture.shape) or (has_dark and frame.dtype != picture.dtype):
        given, needed = (
            f"{shown.shape[0]}x{shown.shape[1]} pixels of {shown.shape[2]} channels, {shown.dtype.itemsize * 8} bit"
            for shown in (frame, picture)
        )
        raise InvalidOption(f"{which}: the {which} picture has {given}, the raw one {needed}; give one like it")
    if is_grey:
        frame = frame.repeat(picture.shape[2], axis=2)
    return frame


def _describe_grid(found: Calibration) -> str:
    grid = found.known
    y, x = grid.offset or (0.0, 0.0)
    text = (
        f"lens grid: {grid.shape}, pitch {grid.pitch:.3f} pixels, first lens at {y:.2f},{x:.2f} (y, x), "
        f"rotation {grid.rotation:.3f} degrees"
    )
    if found.cue is None:
        return f"{text}, as given"
    text += f"; {found.share:.0%} of the lenses agree, within {found.scatter:.2f} pixels (median)"
    if found.uncertainty > 0:  # the pitch was not given
        text += f", which settles the pitch times all lenses to {found.uncertainty:.2f} pixels (standard error)"
    if found.cue == "edges":
        text += "; lenses don't darken towards their borders, so it may be wrong: see --show-grid"
        pixels = round(found.grid.pitch)
        if abs(found.grid.pitch - pixels) < _WHOLE * pixels:
            text += f"; if it is an elemental image array, leave lens_pitch out and give pixels {pixels}x{pixels}"
    elif found.uncertainty > _SETTLED:
        text += "; a white picture would settle it"
    return text
