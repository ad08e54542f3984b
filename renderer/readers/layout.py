"""The layout of a light field in its file."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, cast

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.readers.lenslet.grid import Known
    from ciir.renderer.views import DepthSense, Flip, Pickup

Arrangement = Literal["auto", "eia", "mosaic"]
"""The arrangement of a picture of all views: elemental images side by side, or views side by side; with `auto`, the
picture's period decides.
"""

OrderCheck = Literal["auto", "given", "rows", "columns", "serpentine"]
"""How rows and columns of views are found. `auto`: from the names and the pictures. `given`: from the names. `rows`:
the first number or index is the row. `columns`: it is the column. `serpentine`: from the names, but with every other
row from right to left.
"""

TEXT = "ciir layout"
"""The keyword of the text in which our PNGs describe how their views are laid out."""
DEPTH_SENSE_TEXT = "ciir depth sense"
"""The keyword of the text in which each of our views states the depth sense of its set."""
_WRITTEN = re.compile(r"(eia|mosaic) pixels=(\d{1,5})x(\d{1,5}) lenses=(\d{1,5})x(\d{1,5}) pickup=(virtual|optical)")


@dataclass(frozen=True)
class Layout:
    """The layout of a light field in its file, as far as given. Readers use it for what their format leaves open."""

    lenses: tuple[int, int] | None = None
    """Rows and columns of lenses, which are the pixels of a view."""
    pixels: tuple[int, int] | None = None
    """Rows and columns of pixels under a lens, which are the views."""
    pickup: Pickup | None = None
    """The pickup; None for that of the file, or virtual if the file states none."""
    frame: int = 0
    """Which frame of a video is read, if `selects_frame` is true or its name says that it is of quilts."""
    arrangement: Arrangement = "auto"
    crop: tuple[int, int, int, int] = (0, 0, 0, 0)
    """The margin in pixels around an elemental image array or a mosaic: top, left, bottom, right."""
    order: OrderCheck = "auto"
    flip: Flip = "none"
    """The order of views that is reversed, after `transpose`."""
    transpose: bool = False
    """Whether rows and columns of views are exchanged."""
    depth_sense: DepthSense | None = None
    """Whether views, in file order, count pixels under lenses or cameras; None if the file or its format decides."""
    restores_jpeg: bool = False
    """Whether the rounding in an elemental image array that is a JPEG is partly undone."""
    lens_grid: Known | None = None
    """The lens grid of a raw lenslet picture; None if the picture is an elemental image array."""

    @property
    def sequence(self) -> tuple[int, int] | None:
        """Rows and columns that consecutive views fill row by row, before `order` is applied: `pixels`, exchanged if
        `order` is columns.
        """
        return self.pixels[::-1] if self.pixels and self.order == "columns" else self.pixels

    @property
    def selects_frame(self) -> bool:
        """Whether one frame of a video is read, an elemental image array or a mosaic, and not all frames as views."""
        return self.lenses is not None or self.arrangement != "auto"

    def complete(self, text: str, size: tuple[int, int]) -> Layout:
        """Returns the layout completed from the text of a picture of `size` (`write_text`). It is unchanged if other
        values are given, or if the picture has another size: software that cuts or scales a picture may keep its texts.
        """
        found = _WRITTEN.fullmatch(text)
        if found is None or self.arrangement != "auto" or any(self.crop):
            return self
        v, u, rows, cols = map(int, found.groups()[1:5])
        agrees = self.pixels in (None, (v, u)) and self.lenses in (None, (rows, cols))
        if not agrees or (v * rows, u * cols) != size:
            return self
        arrangement = cast("Arrangement", found[1])
        pickup = self.pickup or cast("Pickup", found[6])
        return replace(self, pixels=(v, u), lenses=(rows, cols), arrangement=arrangement, pickup=pickup)


def write_text(arrangement: Literal["eia", "mosaic"], shape: Sequence[int], pickup: Pickup = "virtual") -> str:
    """Returns the text that describes in a PNG how views of `shape`, `(V, U, H, W, C)`, are laid out."""
    return "{} pixels={}x{} lenses={}x{} pickup={}".format(arrangement, *shape[:4], pickup)
