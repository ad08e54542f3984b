"""Writes a light field's middle row of views as a quilt for lenticular displays (Looking Glass)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.renderer.displays.devices import DEFAULT, find_device
from ciir.renderer.displays.light_fields import make_quilt
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.writers.pictures import SUFFIXES, encode
from ciir.renderer.writers.whole import WholeWriter

if TYPE_CHECKING:
    from ciir.renderer.light_field import LightField
    from ciir.renderer.writers.writer import Contents


class QuiltWriter(WholeWriter):
    """Writes a quilt with the columns and rows of a device; the views keep their own shape."""

    name = "quilt"

    def check(self, contents: Contents) -> None:
        """Refuses an unknown device, and pixels that the picture format can't hold."""
        find_device(self.options.device or DEFAULT)
        encode(contents.sample, self.options.suffix or SUFFIXES[0])

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the picture; a note says what to name it."""
        layout = find_device(self.options.device or DEFAULT).layout
        height, width = light_field.views.shape[2:4]
        quilt, layout, notes = make_quilt(
            light_field,
            layout,
            own_aspect=width / height,
            keeps_aspect=not self.options.device,
            max_pixels=DEFAULT_LIMITS.pixels,
        )
        self.file.write(encode(quilt, self.options.suffix or SUFFIXES[0]))
        return [
            *notes,
            f"quilt: name it NAME{layout.suffix}{SUFFIXES[0]}; displays read columns, rows and aspect there",
        ]
