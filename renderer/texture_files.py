"""The files that a mesh refers to, looked up in its bundle alone, and pictures among them made textures."""

from __future__ import annotations

import posixpath
from typing import TYPE_CHECKING

import numpy as np

from renderer import pictures
from renderer.errors import InputError
from renderer.names import inside, shown
from renderer.scene import Texture, Wrap

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

MAX_PIXELS = 64_000_000
"""Most pixels in all textures of a mesh together."""


class Resolver:
    """Files by the names that a mesh uses for them, relative to the folder of the mesh's own file `main`.

    Never raises for a name: what isn't there, or would be outside, is None with a line in `notes`.
    """

    def __init__(self, files: Mapping[str, bytes], main: str) -> None:
        self.notes: list[str] = []
        self._files = files
        self._folder = posixpath.dirname(main)
        self._pixels_left = MAX_PIXELS
        self._decoded: dict[tuple[str, bool], NDArray[np.uint8] | None] = {}
        self._textures: dict[tuple[str, bool, Wrap, Wrap], Texture] = {}

    def find(self, name: str, what: str) -> bytes | None:
        """The bytes of the file called `name`; `what` it is stands in the note where there is none."""
        name = name.replace("\\", "/").removeprefix("./")  # as Windows exporters write it
        key = inside(name, self._folder)
        # Exporters keep the path of the machine that they ran on; the file itself travels beside the mesh.
        for candidate in (key, inside(posixpath.basename(name), self._folder)):
            if candidate is not None and candidate in self._files:
                return self._files[candidate]
        if key is None:
            self.note(f"{what} {shown(name)} is outside what was given and is left out; put it beside the mesh")
        else:
            self.note(f"{what} {shown(name)} is missing and is left out; give a zip or a folder that holds it")
        return None

    def texture(self, name: str, *, opaque: bool, wrap_u: Wrap = "repeat", wrap_v: Wrap = "repeat") -> Texture | None:
        """The picture file called `name` as a texture; `opaque` sets its alpha to 255 throughout."""
        data = self.find(name, "texture")
        return None if data is None else self.decoded(data, name, opaque=opaque, wrap_u=wrap_u, wrap_v=wrap_v)

    def decoded(self, data: bytes, name: str, *, opaque: bool, wrap_u: Wrap, wrap_v: Wrap) -> Texture | None:
        """A picture's bytes as a texture, made once for each `name`; None with a note where they can't be read."""
        if (name, opaque) not in self._decoded:
            self._decoded[name, opaque] = self._pixels(data, name, opaque=opaque)
        pixels = self._decoded[name, opaque]
        if pixels is None:
            return None
        return self._textures.setdefault((name, opaque, wrap_u, wrap_v), Texture(pixels, wrap_u, wrap_v))

    def note(self, line: str) -> None:
        """Add a line to `notes` unless it is there already."""
        if line not in self.notes:
            self.notes.append(line)

    def _pixels(self, data: bytes, name: str, *, opaque: bool) -> NDArray[np.uint8] | None:
        try:
            pixels = pictures.decode(data, name=shown(name), max_pixels=self._pixels_left)
        except InputError as error:
            self.note(f"texture {shown(name)} is left out: {error}")
            return None
        self._pixels_left -= pixels.shape[0] * pixels.shape[1]
        return rgba8(pixels, opaque=opaque)


def rgba8(pixels: NDArray[np.uint8] | NDArray[np.uint16], *, opaque: bool) -> NDArray[np.uint8]:
    """Pixels `(h, w, 1 to 4)` of 8 or 16 bit as `(h, w, 4)` RGBA of 8 bit; 65535 goes to 255, rounded."""
    if pixels.dtype == np.uint16:
        pixels = ((pixels.astype(np.uint32) * 255 + 32767) // 65535).astype(np.uint8)
    channels = pixels.shape[2]
    rgba = np.full((*pixels.shape[:2], 4), 255, np.uint8)
    rgba[:, :, :3] = pixels[:, :, :1] if channels <= 2 else pixels[:, :, :3]
    if channels in {2, 4} and not opaque:
        rgba[:, :, 3] = pixels[:, :, -1]
    return rgba
