"""How a light field lies in its file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from ciir.renderer.light_field import DepthSense, Pickup
    from ciir.renderer.readers.lenslet.grid import Known
    from ciir.renderer.views import Flip

Arrangement = Literal["auto", "eia", "mosaic"]
"""What a picture of all views is: elemental images side by side, or views side by side; `auto`: which its period shows.
"""

OrderCheck = Literal["auto", "given", "rows", "columns", "serpentine"]
"""What is row and what is column: what the names and the pictures show; what the names show; the first number or index
is the row; or it is the column; or as the names show, but every other row from right to left.
"""


@dataclass(frozen=True)
class Layout:
    """How a light field lies in its file, as far as that is given. A reader uses what its format leaves open."""

    lenses: tuple[int, int] | None = None
    """Rows and columns of lenses: the pixels of a view."""
    pixels: tuple[int, int] | None = None
    """Rows and columns of pixels under a lens: the number of views."""
    pickup: Pickup = "virtual"
    frame: int = 0
    """Of a video, where `selects_frame`: which one."""
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
    def selects_frame(self) -> bool:
        """Whether one frame of a video is read, an elemental image array or a mosaic, and not all frames as views."""
        return self.lenses is not None or self.arrangement != "auto"
