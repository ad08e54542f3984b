"""Writes a light field as one HTML file that shows it: a viewer that contains the views and needs no server."""

from __future__ import annotations

import base64
import html
import json
import re
from importlib.resources import files
from string import Template
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from ciir.bit_depth import count_unused_camera_bits
from ciir.errors import InvalidOption
from ciir.renderer.levels import note_rounding, round_to_8_bit
from ciir.renderer.views import parse_views
from ciir.renderer.writers.pictures import encode
from ciir.renderer.writers.writer import Writer, file_name

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.renderer.writers.writer import Contents

MOST_VIEWS = 2048
"""The layers of a WebGL 2 texture that common graphics processors have; 256 are guaranteed."""

MODULES = ("texts.js", "disparity.js", "viewer.js", "movement.js", "page.js")
"""The viewer's modules, each after those that it imports."""


class HtmlWriter(Writer):
    """Writes one page with all views as JPEG of quality 95 and 8 bit; alpha is left out."""

    def __init__(self, file: IO[bytes], *_: object) -> None:
        self._file = file
        self._views: dict[View, str] = {}
        self._kept: dict[View, Pixels] = {}
        self._unused = 0

    def begin(self, contents: Contents) -> None:
        """Refuses a part of a light field's views, and more than `MOST_VIEWS`."""
        contents.refuse_times("html")
        if sorted(contents.views) != parse_views("all", *contents.grid):
            count = len(contents.views)
            wanted = "1 view is" if count == 1 else f"{count} views are"
            raise InvalidOption(f"format: html holds whole light fields and {wanted} wanted; give views all")
        if len(contents.views) > MOST_VIEWS:
            raise InvalidOption(
                f"format: {len(contents.views)} views; html holds at most {MOST_VIEWS}; give a light field with fewer"
            )
        self._contents = contents

    def write(self, view: View, pixels: Pixels) -> str:
        """Adds a picture; 16-bit ones with the last one, as only all of them show how many bits the camera has."""
        self._kept[view] = pixels
        if pixels.dtype == np.uint8 or len(self._kept) == len(self._contents.views):
            self._unused = count_unused_camera_bits(*self._kept.values())
            self._views |= {key: _encode(round_to_8_bit(kept, self._unused)) for key, kept in self._kept.items()}
            self._kept.clear()
        return file_name(view)

    def finish(self, report: dict[str, Any]) -> None:
        """Writes the page, and adds notes on what it doesn't hold to the report."""
        contents = self._contents
        notes = ["html: alpha is left out"] * (contents.channels in (2, 4))
        notes += note_rounding("html", contents.dtype, self._unused)
        if notes:
            report["notes"] += notes
        light_field = {
            "rows": contents.grid[0],
            "cols": contents.grid[1],
            "width": contents.width,
            "height": contents.height,
            "depthSense": contents.depth_sense,
            "scale": contents.scale,
            "views": [self._views[view] for view in sorted(self._views)],
        }
        folder = files("ciir.renderer.writers") / "viewer"
        script = "\n".join((folder / name).read_text("utf-8") for name in MODULES)
        filled = Template((folder / "viewer.html").read_text("utf-8")).substitute(
            title=html.escape(str(report.get("input", {}).get("name", "Light field"))),
            style=(folder / "viewer.css").read_text("utf-8"),
            script=re.sub(r"(?m)^import .*$", "", script),
            light_field=json.dumps(light_field),
        )
        self._file.write(filled.encode())


def _encode(pixels: Pixels) -> str:
    """Returns an 8-bit picture as a data URL of a JPEG."""
    jpeg = encode(pixels[..., : 1 if pixels.shape[2] < 3 else 3], ".jpg")
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
