"""How a light field lies in its file."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, cast

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.readers.lenslet.grid import Known
    from ciir.renderer.views import DepthSense, Flip, Pickup

Arrangement = Literal["auto", "eia", "mosaic"]
"""What a picture of all views is: elemental images side by side, or views side by side; `auto`: which its period shows.
"""

OrderCheck = Literal["auto", "given", "rows", "columns", "serpentine"]
"""What is row and what is column: what the names and the pictures show; what the names show; the first number or index
is the row; or it is the column; or as the names show, but every other row from right to left.
"""

TEXT = "ciir layout"
"""The keyword of the text by which a PNG that we write says how its views lie in it."""
_WRITTEN = re.compile(r"(eia|mosaic) pixels=(\d{1,5})x(\d{1,5}) lenses=(\d{1,5})x(\d{1,5}) pickup=(virtual|optical)")


@dataclass(frozen=True)
class Layout:
    """How a light field lies in its file, as far as that is given. A reader uses what its format leaves open."""

    lenses: tuple[int, int] | None = None
    """Rows and columns of lenses: the pixels of a view."""
    pixels: tuple[int, int] | None = None
    """Rows and columns of pixels under a lens: the number of views."""
    pickup: Pickup | None = None
    """None: as the file says, else virtual."""
    frame: int = 0
    """Of a video, where `selects_frame` or its name says that it is of quilts: which one."""
    arrangement: Arrangement = "auto"
    crop: tuple[int, int, int, int] = (0, 0, 0, 0)
    """Pixels of margin around an elemental image array or a mosaic: top, left, bottom, right."""
    order: OrderCheck = "auto"
    flip: Flip = "none"
    """Which order of views is reversed, after `transpose`."""
    transpose: bool = False
    """Whether rows and columns of views are exchanged."""
    depth_sense: DepthSense | None = None
    """Whether views, in the order of the file, count pixels under lenses or cameras; None: as the file or its format
    says."""
    restores_jpeg: bool = False
    """Whether the rounding of an elemental image array that is a JPEG is undone in part."""
    lens_grid: Known | None = None
    """Of a raw lenslet picture; None for a picture that is an elemental image array."""

    @property
    def sequence(self) -> tuple[int, int] | None:
        """Rows and columns that views one after another fill row by row, before `order` is taken: `pixels`, with
        `order` columns exchanged.
        """
        return self.pixels[::-1] if self.pixels and self.order == "columns" else self.pixels

    @property
    def selects_frame(self) -> bool:
        """Whether one frame of a video is read, an elemental image array or a mosaic, and not all frames as views."""
        return self.lenses is not None or self.arrangement != "auto"

    def complete(self, text: str, size: tuple[int, int]) -> Layout:
        """With what the text of a picture of `size` says (`write_text`). Unchanged where other things are given, or
        where it is of another size: what cuts or scales a picture may keep its texts.
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
    """The text by which a PNG says how views of `shape`, `(V, U, H, W, C)`, lie in it."""
    return "{} pixels={}x{} lenses={}x{} pickup={}".format(arrangement, *shape[:4], pickup)
