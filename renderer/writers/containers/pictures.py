"""Writes a light field as a picture: an elemental image array, ESLF, a mosaic of views, a TIFF stack, or an epipolar
plane image.
"""

from __future__ import annotations

import io
from abc import abstractmethod
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
import tifffile

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.layout import TEXT, write_text
from ciir.renderer.writers.options import parse_epi
from ciir.renderer.writers.pictures import SUFFIXES, encode
from ciir.renderer.writers.pictures.tiff import describe_page
from ciir.renderer.writers.whole import WholeWriter

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.writers.writer import Contents

ESLF_PIXELS = 14
"""Pixels along each side of a lens."""

ONE_ROW = (
    "eia: lenses of {columns} pixels side by side, as there is one row of views; for a quilt give format quilt, or a "
    "name with its layout, such as _qs8x6a0.75"
)
"""A note on elemental image arrays of one row of views."""


class PictureWriter(WholeWriter):
    """Writes a picture made from the light field."""

    arrangement: Literal["eia", "mosaic"] | None = None
    """How the views lie in the picture, which a PNG states; None if it isn't read that way."""

    @abstractmethod
    def draw(self, light_field: LightField) -> Pixels:
        """Returns the picture, `(height, width, C)`."""

    def check(self, contents: Contents) -> None:
        """Refuses pixels that the picture format can't hold."""
        encode(contents.sample, self.options.suffix or SUFFIXES[0])

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the picture."""
        text = {} if self.arrangement is None else {TEXT: write_text(self.arrangement, light_field.shape)}
        self.file.write(encode(self.draw(light_field), self.options.suffix or SUFFIXES[0], text))
        return []


class EiaWriter(PictureWriter):
    """Writes the elemental image array: pixel (y*V + v, x*U + u) is pixel (y, x) of view (v, u)."""

    sense = "lenses"
    arrangement = "eia"

    def draw(self, light_field: LightField) -> Pixels:
        """Returns the elemental image array."""
        return light_field.eia()

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the picture, with a note on a single row of views, as quilts have it."""
        rows, columns = light_field.shape[:2]
        notes = [ONE_ROW.format(columns=columns)] if rows == 1 < columns else []
        return [*super().encode(light_field), *notes]


class MosaicWriter(PictureWriter):
    """Writes the views side by side: pixel (v*H + y, u*W + x) is pixel (y, x) of view (v, u)."""

    sense = "cameras"
    arrangement = "mosaic"

    def draw(self, light_field: LightField) -> Pixels:
        """Returns the mosaic."""
        rows, columns, height, width, channels = light_field.views.shape
        return light_field.views.swapaxes(1, 2).reshape(rows * height, columns * width, channels)


class EslfWriter(PictureWriter):
    """Writes Lytro's ESLF: 14x14 pixels under each lens, with empty pixels around the views."""

    sense = "cameras"
    holds_alpha = False
    """Alpha would be taken for a weight."""

    def check(self, contents: Contents) -> None:
        """Refuses more views than a lens has pixels."""
        super().check(contents)
        if max(contents.grid) > ESLF_PIXELS:
            raise InvalidOption(
                f"format: eslf holds up to {ESLF_PIXELS}x{ESLF_PIXELS} views, not {contents.grid[0]}x"
                f"{contents.grid[1]}; give format eia"
            )

    def draw(self, light_field: LightField) -> Pixels:
        """Returns the elemental image array, with the views in the middle of each lens."""
        views = light_field.views
        margins = [((ESLF_PIXELS - count) // 2, (ESLF_PIXELS - count + 1) // 2) for count in views.shape[:2]]
        return LightField(cast("Pixels", np.pad(views, (*margins, (0, 0), (0, 0), (0, 0))))).eia()


class StackWriter(WholeWriter):
    """Writes a TIFF with a page for each view, row by row; the first page's description has the grid and the sense."""

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the pages (deflate, horizontal differences)."""
        views = light_field.views
        channels = views.shape[4]
        metadata = {"axes": "QQYXS" if channels > 1 else "QQYX", "depth_sense": light_field.depth_sense}
        described = {**describe_page(channels), "metadata": metadata}
        packed = io.BytesIO()
        tifffile.imwrite(packed, views if channels > 1 else views[..., 0], **described)
        self.file.write(packed.getbuffer())
        return []


class EpiWriter(PictureWriter):
    """Writes the epipolar plane image of one line (Bolles, Baker & Marimont 1987)."""

    def check(self, contents: Contents) -> None:
        """Refuses a line that does not exist."""
        super().check(contents)
        sizes = {"y": contents.height, "x": contents.width, "v": contents.grid[0], "u": contents.grid[1]}
        for name, number in parse_epi(self.options.epi).items():
            if number >= sizes[name]:
                raise InvalidOption(f"epi: there is no {name}={number}; give 0 to {sizes[name] - 1}")

    def draw(self, light_field: LightField) -> Pixels:
        """Returns the epipolar plane image."""
        return light_field.epi(**parse_epi(self.options.epi))
