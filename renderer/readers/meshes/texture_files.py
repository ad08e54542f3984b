"""Finds the files that a mesh refers to in its bundle and decodes textures."""

from __future__ import annotations

import math
import posixpath
import unicodedata
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InputError, TooLarge
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers import pictures
from ciir.renderer.readers.meshes.texture_formats import find_texture_format
from ciir.renderer.readers.names import clean_text, resolve_key
from ciir.renderer.scene import Texture, Wrap

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

MAX_SIDE = 16_384
"""The most pixels along one side of a texture: the smallest limit of the OpenGL drivers that were tried."""
MOST_WORK = 4
"""How many times the pixel limit of all textures may be decoded. Textures over the limit are scaled down afterwards."""
FIRST_TILE = "1001"
"""The number of the UDIM tile at texture coordinates from 0 to 1."""
MAX_NOTES = 50
_FULL = f"over {MAX_NOTES} things were left out or replaced; the rest are not listed"


class Resolver:
    """Finds files by the names in a mesh, relative to the folder of the mesh's own file `main`.

    A file that is missing or outside the bundle is never an error: the result is None, and a line is added to `notes`.
    `used` holds the keys of the files that were found.
    """

    def __init__(self, files: Mapping[str, bytes], main: str, max_pixels: int = DEFAULT_LIMITS.pixels) -> None:
        self._notes: dict[str, None] = {}
        self.used: set[str] = set()
        self._files = files
        self._folder = posixpath.dirname(main)
        self._max_pixels = self._pixels_left = max_pixels
        self._work_left = MOST_WORK * max_pixels  # pixels of corrupt textures count, too
        self._decoded: dict[tuple[str, bool], NDArray[np.uint8] | None] = {}
        self._textures: dict[tuple[str, bool, Wrap, Wrap, bool], Texture] = {}

    @property
    def notes(self) -> list[str]:
        """Notes on what was left out or replaced, in the order of the file and without duplicates."""
        return list(self._notes)

    def add_note(self, line: str) -> None:
        """Adds a line to `notes`, unless it is already there or there are `MAX_NOTES` lines."""
        self._notes.setdefault(line if len(self._notes) < MAX_NOTES else _FULL)

    def find(self, name: str) -> bytes | None:
        """Returns the bytes of the file called `name`, or None if it is missing or outside the bundle."""
        name = _portable(name)
        own = posixpath.basename(name)
        # Exporters write paths of their own machine; the file itself is in the mesh's folder.
        candidates = [key for each in (name, own) if (key := resolve_key(each, self._folder)) is not None]
        for key in candidates:
            if key in self._files:
                return self._take(key)
        others = self._named.get(_compose(own).lower(), [])
        composed = {_compose(key) for key in candidates}
        if same := [key for key in others if _compose(key) in composed]:
            return self._take(same[0])
        if len(others) != 1:
            return None
        self.add_note(f"{clean_text(name)} is missing; {clean_text(others[0])}, the only file of that name, is used")
        return self._take(others[0])

    def _take(self, key: str) -> bytes:
        self.used.add(key)
        return self._files[key]

    def find_only(self, suffix: str) -> tuple[str, bytes] | None:
        """Returns the key and the bytes of the only file whose name ends with `suffix`, which is in lower case. Returns
        None if there is no such file or more than one."""
        found = [key for own, keys in self._named.items() if own.endswith(suffix) for key in keys]
        return (found[0], self._take(found[0])) if len(found) == 1 else None

    @cached_property
    def _named(self) -> dict[str, list[str]]:
        """The files in all folders, by their names in lower case. Downloads often keep textures in a separate folder,
        and their names may come from systems that ignore case."""
        named: dict[str, list[str]] = {}
        try:
            for key in self._files:
                named.setdefault(_compose(posixpath.basename(key)).lower(), []).append(key)
        except TooLarge:  # a mesh on the disk, with too many files in its folder to search
            return {}
        return named

    def explain_missing(self, name: str) -> tuple[str, str]:
        """Returns why there is no file called `name`, and the remedy."""
        is_outside = resolve_key(_portable(name), self._folder) is None
        why = "is outside what was given" if is_outside else "is missing"
        return why, "put it next to the mesh, or give a zip that holds both"

    def find_or_note(self, name: str, what: str) -> bytes | None:
        """Finds a file as `find` does, and adds a note if it is missing. `what` names the kind of file in the note. The
        first tile is taken of a texture in tiles (UDIM).
        """
        first = name.replace("<UDIM>", FIRST_TILE)
        data = self.find(first)
        if data is None:
            why, remedy = self.explain_missing(first)
            self.add_note(f"{what} {clean_text(first)} {why} and is left out; {remedy}")
        elif first != name:
            self.add_note(f"{what} {clean_text(name)}: only tile {FIRST_TILE} is drawn, on all faces; bake one picture")
        return data

    def load_texture(
        self, name: str, *, opaque: bool, wrap_u: Wrap = "repeat", wrap_v: Wrap = "repeat"
    ) -> Texture | None:
        """Loads the picture file called `name` as a texture. `opaque` sets its alpha to 255 everywhere."""
        return self.decode_texture(
            lambda: self.find_or_note(name, "texture"), key=name, name=name, opaque=opaque, wrap_u=wrap_u, wrap_v=wrap_v
        )

    def load_masked_texture(self, name: str | None, mask: str, *, wrap_u: Wrap, wrap_v: Wrap) -> Texture | None:
        """Loads the picture file called `name` as a texture, or white if `name` is None. Its alpha is the alpha of the
        picture `mask`, or the brightness of `mask` if that is opaque. Returns None if one of the two can't be read.
        """
        key = f"{name}\0{mask}"
        if (key, False) not in self._decoded:
            self._decoded[key, False] = self._mask(name, mask)
        pixels = self._decoded[key, False]
        if pixels is None:
            return None
        return self._textures.setdefault((key, False, wrap_u, wrap_v, False), Texture(pixels, wrap_u, wrap_v))

    def _mask(self, name: str | None, mask: str) -> NDArray[np.uint8] | None:
        from PIL import Image  # not loaded in the web process

        alpha = self.load_texture(mask, opaque=False)
        color = alpha if name is None else self.load_texture(name, opaque=True)
        if alpha is None or color is None:
            return None
        height, width = color.pixels.shape[:2]
        if height * width > self._pixels_left:
            self.add_note(
                f"the opacity map {clean_text(mask)} is left out: the textures are too large; scale them down"
            )
            return None
        self._pixels_left -= height * width
        levels = alpha.pixels[..., 3 if alpha.pixels[..., 3].min() < 255 else 1]
        fitted = Image.fromarray(np.ascontiguousarray(levels)).resize((width, height), Image.Resampling.BILINEAR)
        pixels = np.full_like(color.pixels, 255) if name is None else color.pixels.copy()
        pixels[..., 3] = np.asarray(fitted)
        return pixels

    def decode_texture(
        self,
        load: Callable[[], bytes | None],
        *,
        key: str,
        name: str,
        opaque: bool,
        wrap_u: Wrap,
        wrap_v: Wrap,
        is_nearest: bool = False,
    ) -> Texture | None:
        """Decodes the picture whose bytes `load` returns as a texture; returns None, with a note, if it can't be read.

        Pictures with the same `key` are loaded and decoded once. `name` is the picture's name in notes.
        """
        if (key, opaque) not in self._decoded:
            self._decoded[key, opaque] = self._pixels(load, name, opaque=opaque)
        pixels = self._decoded[key, opaque]
        if pixels is None:
            return None
        texture = Texture(pixels, wrap_u, wrap_v, is_nearest)
        return self._textures.setdefault((key, opaque, wrap_u, wrap_v, is_nearest), texture)

    def _pixels(self, load: Callable[[], bytes | None], name: str, *, opaque: bool) -> NDArray[np.uint8] | None:
        def charge(height: int, width: int) -> None:
            if max(height, width) > MAX_SIDE:
                raise TooLarge(f"{height}x{width} pixels; at most {MAX_SIDE:,} along a side are drawn; scale it down")
            if height * width > self._work_left:
                raise TooLarge(
                    f"{height}x{width} pixels; {max(self._work_left, 0):,} are left of the "
                    f"{MOST_WORK * self._max_pixels:,} that are decoded for all textures; scale them down"
                )
            # Charged before decoding: a picture that fails costs as much, and so does a long file with few pixels.
            self._work_left -= max(height * width, len(data or b"") // 64)

        if min(self._work_left, self._pixels_left) <= 0:
            self.add_note(f"textures over {self._max_pixels:,} pixels in all are left out; scale them down")
            return None
        data = load()
        if data is None:
            return None
        try:
            other = find_texture_format(name, data)
            shown, limit = clean_text(name), self._max_pixels
            pixels = pictures.decode(data, name=shown, max_pixels=limit, check=charge, other=other)
        except InputError as error:
            self._work_left -= len(data) // 64
            self.add_note(f"texture {clean_text(name)} is left out: {error}")
            return None
        return self._fit(to_rgba8(pixels, opaque=opaque), name)

    def _fit(self, pixels: NDArray[np.uint8], name: str) -> NDArray[np.uint8]:
        """Scales `pixels` down if they use more than half of the pixels left, so that other textures get some."""
        from PIL import Image  # not loaded in the web process

        height, width = pixels.shape[:2]
        factor = math.ceil(math.sqrt(2 * height * width / self._pixels_left))
        if factor > 1:
            pixels = np.asarray(Image.fromarray(pixels).reduce(factor))
            self.add_note(
                f"texture {clean_text(name)} is scaled down from {height}x{width} to {pixels.shape[0]}x"
                f"{pixels.shape[1]} pixels: each may have half of what is left of {self._max_pixels:,} for all"
            )
        self._pixels_left -= pixels.shape[0] * pixels.shape[1]
        return pixels


def _portable(name: str) -> str:
    """Returns the name with `/` in place of Windows' separators."""
    return name.replace("\\", "/").removeprefix("./")


def _compose(name: str) -> str:
    """Returns the name with each accented letter as one character: macOS stores letters and accents separately."""
    return unicodedata.normalize("NFC", name)


def to_rgba8(pixels: NDArray[np.uint8] | NDArray[np.uint16], *, opaque: bool) -> NDArray[np.uint8]:
    """Converts pixels `(h, w, 1 to 4)` of 8 or 16 bit to 8-bit RGBA `(h, w, 4)`, rounded. `opaque` ignores alpha."""
    if pixels.dtype == np.uint16:
        pixels = ((pixels.astype(np.uint32) * 255 + 32767) // 65535).astype(np.uint8)
    channels = pixels.shape[2]
    rgba = np.full((*pixels.shape[:2], 4), 255, np.uint8)
    for channel in range(3):  # one at a time: NumPy copies rows of 3 slowly
        rgba[:, :, channel] = pixels[:, :, channel if channels > 2 else 0]
    if channels in {2, 4} and not opaque:
        rgba[:, :, 3] = pixels[:, :, -1]
    return rgba
