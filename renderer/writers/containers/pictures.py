"""Writes a light field as one picture: an elemental image array, or an epipolar plane image."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.writers.options import EpiLine
from ciir.renderer.writers.pictures import SUFFIXES, encode
from ciir.renderer.writers.whole import WholeWriter

if TYPE_CHECKING:
    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.writers.writer import Contents


class PictureWriter(WholeWriter):
    """Writes a picture that is made of the light field."""

    @abstractmethod
    def draw(self, light_field: LightField) -> Pixels:
        """The picture, `(height, width, C)`."""

    def check(self, contents: Contents) -> None:
        """Refuses pixels that the picture format can't hold."""
        encode(contents.sample, self.options.suffix or SUFFIXES[0])

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the picture."""
        self.file.write(encode(self.draw(light_field), self.options.suffix or SUFFIXES[0]))
        return []


class EiaWriter(PictureWriter):
    """Writes the elemental image array: pixel (y*V + v, x*U + u) is pixel (y, x) of view (v, u)."""

    name = "eia"

    def draw(self, light_field: LightField) -> Pixels:
        """The elemental image array."""
        return light_field.eia()


class EpiWriter(PictureWriter):
    """Writes the epipolar plane image of one line (Bolles, Baker & Marimont 1987)."""

    name = "epi"

    def check(self, contents: Contents) -> None:
        """Refuses a line that is not there."""
        super().check(contents)
        line = EpiLine.parse(self.options.epi)
        sizes = {"y": contents.height, "x": contents.width, "v": contents.grid[0], "u": contents.grid[1]}
        for name, size in sizes.items():
            if (getattr(line, name) or 0) >= size:
                raise InvalidOption(f"epi: there is no {name}={getattr(line, name)}; give 0 to {size - 1}")

    def draw(self, light_field: LightField) -> Pixels:
        """The epipolar plane image."""
        line = EpiLine.parse(self.options.epi)
        return light_field.epi(y=line.y, x=line.x, v=line.v, u=line.u)
