"""Looking Glass displays, by the quilts that they take.

Sizes: https://lfdocs.lookingglassfactory.com/keyconcepts/quilts, and pylightio (AliceLG), `lightfields.py`; a 16 inch
display in landscape reports 8x6 views in 7680x4320 pixels and a cone of 50 degrees, not the 7x7 of that page.
"""

from __future__ import annotations

from dataclasses import dataclass

from ciir.errors import InvalidOption
from ciir.renderer.displays.quilt import QuiltLayout


@dataclass(frozen=True)
class Device:
    """A display: its quilt's layout and size in pixels, and the angle between its outermost cameras."""

    layout: QuiltLayout
    width: int
    height: int
    cone: float = 40.0
    """Degrees."""

    @property
    def tile(self) -> tuple[int, int]:
        """Height and width of a view in the quilt, pixels."""
        return self.height // self.layout.rows, self.width // self.layout.cols


LANDSCAPE, PORTRAIT = 16 / 9, 9 / 16
DEFAULT = "portrait"
DEVICES = {
    "portrait": Device(QuiltLayout(8, 6, 0.75), 3360, 3360),
    "go": Device(QuiltLayout(11, 6, PORTRAIT), 4092, 4092),
    "16-landscape": Device(QuiltLayout(8, 6, LANDSCAPE), 7680, 4320, 50.0),
    "16-portrait": Device(QuiltLayout(11, 6, PORTRAIT), 5995, 6000),
    "32-landscape": Device(QuiltLayout(7, 7, LANDSCAPE), 8190, 8190),
    "32-portrait": Device(QuiltLayout(11, 6, PORTRAIT), 8184, 8184),
    "65": Device(QuiltLayout(8, 9, LANDSCAPE), 8192, 8190),
    "8.9": Device(QuiltLayout(5, 9, 1.6), 4095, 4095),
}
"""By name."""


def find_device(name: str) -> Device:
    """The device called `name`. Raises `InvalidOption` for an unknown one."""
    if name not in DEVICES:
        raise InvalidOption(
            f"device: {name[:40]!r} is not known; give {', '.join(DEVICES)}, or a layout as in quilt 8x6 aspect 0.75"
        )
    return DEVICES[name]
