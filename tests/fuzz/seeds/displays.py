"""Seeds of files that describe displays, and quilts."""

from __future__ import annotations

import json

from ciir.renderer.displays.quilt import QuiltLayout
from tests.support.displays import CALIBRATION

PANEL = """
[panel]
pixels = [60, 40]
ppi = 254.0
subpixels = "bgr"
[lenses]
pitch = 1.25
gap = 3.3
grid = "hexagonal"
offset = [0.5, -0.25]
rotation = -2.5
[viewer]
distance = 600
"""


def quilts() -> list[bytes]:
    """The layout at the top, and as Looking Glass' studio nests it."""
    text = QuiltLayout(3, 2, 0.75).to_json()
    return [text.encode(), json.dumps({"quilt_settings": json.loads(text)}).encode()]


def panels() -> list[bytes]:
    """Every entry, and those that are needed."""
    return [PANEL.encode(), b"[panel]\npixels = [6, 4]\npitch = 0.4\n[lenses]\npitch = 1\ngap = 3\n"]


def calibrations() -> list[bytes]:
    """Numbers in objects, as displays hold them, and plain ones."""
    plain = {key: value["value"] if isinstance(value, dict) else value for key, value in CALIBRATION.items()}
    return [json.dumps(CALIBRATION).encode(), json.dumps(plain).encode()]


def forms() -> list[bytes]:
    """A form for each kind of picture, with descriptions as files and as a plain field."""
    head = b'--bound\r\nContent-Disposition: form-data; name="%b"%b\r\n\r\n%b\r\n'
    file = head % (b"file", b'; filename="a.npz"', b"PK")
    parts = [
        head % (b"display", b'; filename="p.toml"', panels()[0]) + head % (b"conversion", b"", b"none"),
        head % (b"display", b"", panels()[1]) + head % (b"disparity", b"", b"0.5"),
        head % (b"calibration", b'; filename="c.json"', calibrations()[0]) + head % (b"format", b"", b"lenticular"),
        head % (b"device", b"", b"8.9") + head % (b"quilt", b"", b"3x2") + head % (b"aspect", b"", b"1.5"),
    ]
    return [file + part + b"--bound--\r\n" for part in parts]
