"""Writes a light field as a picture for a display."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING, cast

from ciir.renderer.displays.devices import Quilt, match_views
from ciir.renderer.displays.pictures import find_size, find_target, show_light_field
from ciir.renderer.displays.quilt import parse_name
from ciir.renderer.writers.pictures import BY_SUFFIX, SUFFIXES, encode
from ciir.renderer.writers.whole import WholeWriter

if TYPE_CHECKING:
    from ciir.renderer.displays.pictures import Kind
    from ciir.renderer.light_field import LightField
    from ciir.renderer.writers.writer import Contents


class DisplayWriter(WholeWriter):
    """Writes a quilt of the middle row of views, or the native picture of a lenticular display or a panel."""

    def check(self, contents: Contents) -> None:
        """Refuses a display that is not described, and pixels that the picture format can't hold."""
        named = parse_name(self.options.name)
        self._target = find_target(cast("Kind", self.name), self.options, named=named)
        own_aspect = contents.width / contents.height * contents.pixel_aspect
        if isinstance(self._target, Quilt):
            self._target = match_views(self._target, contents.grid[1], own_aspect)
        suffix = self.options.suffix or SUFFIXES[0]
        size = find_size(self._target, (contents.height, contents.width), own_aspect)
        BY_SUFFIX[suffix].check(size, contents.dtype)
        encode(contents.sample, suffix)

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the picture. A note says how to name a quilt."""
        picture = show_light_field(light_field, self._target, self.options)
        self.file.write(encode(picture.pixels, self.options.suffix or SUFFIXES[0], ppi=picture.ppi))
        notes = [*self._target.notes, *picture.notes]
        if picture.layout is not None:
            self.beside = {".json": picture.layout.to_json().encode()}
            if parse_name(self.options.name) is None:
                given = PurePath(self.options.name or f"NAME{SUFFIXES[0]}")
                name = f"{given.stem}{picture.layout.suffix}{given.suffix}"
                notes.append(f"quilt: name it {name}; displays read columns, rows and aspect there")
        return notes
