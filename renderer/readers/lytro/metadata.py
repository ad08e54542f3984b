"""Reads Lytro's metadata of a picture: its size and packing, its colours, and the lens array.

Names and values are as in the metadata of an F01's and an Illum's file that imageio's tests list
(`tests/test_lytro.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ciir.errors import Unreadable, UnsupportedType
from ciir.renderer.readers.lenslet.grid import LEAST_PITCH, MOST_PITCH, Known, KnownShape, LensGrid
from ciir.renderer.readers.lytro.container import SIGNATURE, read_frame
from ciir.renderer.readers.registry import find_by_signature

CELL = ("r", "gr", "gb", "b")
"""The colours of two rows of two pixels."""
_SHAPES: dict[str, KnownShape] = {
    "squareUniform": "square",
    "hexUniformRowMajor": "hexagonal",
    "hexUniformColumnMajor": "hexagonal-columns",
}


@dataclass(frozen=True)
class Sensor:
    """How pixels are stored, and which colours they mean. Lists of four are in the order of `CELL`."""

    height: int
    width: int
    bits: int
    """12, big-endian, for the F01; 10, little-endian, for the Illum."""
    first: str
    """The colour of the upper left pixel."""
    black: tuple[float, ...]
    white: tuple[float, ...]
    gains: tuple[float, ...] = (1.0,) * 4
    to_srgb: tuple[float, ...] = tuple(np.eye(3).ravel())
    gamma: float = 1 / 2.4
    orientation: int = 1
    """The orientation as in Exif."""


ILLUM = Sensor(5368, 7728, 10, "gr", (64.0,) * 4, (1023.0,) * 4)
F01 = Sensor(3280, 3280, 12, "b", (168.0,) * 4, (4095.0,) * 4)
RAW_SENSORS = {sensor.height * sensor.width * sensor.bits // 8: sensor for sensor in (ILLUM, F01)}
"""Sensors by the size of a `.raw` file in bytes."""


class Fields:
    """Values in nested JSON objects, found by paths such as `image.width` and checked for their type."""

    def __init__(self, metadata: dict[str, Any], name: str) -> None:
        self._metadata, self._name = metadata, name

    def find(self, path: str) -> Any:
        """Returns the value, or None if there is none."""
        value: Any = self._metadata
        for key in path.split("."):
            value = value.get(key) if isinstance(value, dict) else None
        return value

    def text(self, path: str) -> str:
        """Returns the string, or an empty one if there is none."""
        value = self.find(path)
        return value if isinstance(value, str) else ""

    def number(self, path: str, default: float | None = None) -> float:
        """Returns the number. Raises `Unreadable` if there is no finite number and no `default`."""
        value = self.find(path)
        value = default if value is None else value
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
            raise Unreadable(f"{self._name}: its metadata have no number {path}; give the file as the camera wrote it")
        return float(value)

    def colours(self, path: str, default: float | None = None) -> tuple[float, ...]:
        """Returns a number for each colour of `CELL`."""
        return tuple(self.number(f"{path}.{colour}", default) for colour in CELL)


def read_sensor(metadata: dict[str, Any], name: str) -> Sensor:
    """Reads the sensor. Raises `Unreadable` if something is missing, and `UnsupportedType` if the packing is neither of
    the two.
    """
    fields = Fields(metadata, name)
    details = "image.rawDetails" if fields.find("image.rawDetails") is not None else "image"
    bits, first = fields.number(f"{details}.pixelPacking.bitsPerPixel"), fields.text(f"{details}.mosaic.upperLeftPixel")
    order = fields.text(f"{details}.pixelPacking.endianness")
    if (bits, order) not in {(12, "big"), (10, "little")} or first not in CELL:
        raise UnsupportedType(
            f"{name}: its pixels aren't packed like a Lytro F01's or Illum's; give a file of one of these cameras"
        )
    black = fields.colours(f"{details}.pixelFormat.black")
    white = fields.colours(f"{details}.pixelFormat.white")
    if not all(0 <= low < high for low, high in zip(black, white, strict=True)):
        raise Unreadable(f"{name}: its levels of black and white are exchanged; give the file as the camera wrote it")
    ccm = fields.find("image.color.ccm") or fields.find("image.color.ccmRgbToSrgbArray")
    to_srgb = Sensor.to_srgb
    if isinstance(ccm, list) and len(ccm) == 9:
        to_srgb = tuple(Fields({"ccm": value}, name).number("ccm") for value in ccm)
    return Sensor(
        height=int(fields.number("image.height")),
        width=int(fields.number("image.width")),
        bits=int(bits),
        first=first,
        black=black,
        white=white,
        gains=tuple(min(max(gain, 0.0), 16.0) for gain in fields.colours("image.color.whiteBalanceGain", 1.0)),
        to_srgb=to_srgb,
        gamma=min(max(fields.number("image.color.gamma", Sensor.gamma), 0.1), 1.0),
        orientation=int(fields.number("image.orientation", 1)),
    )


@dataclass(frozen=True)
class Camera:
    """The lens array of a camera, as its metadata describes it."""

    known: Known
    """The part that is kept when the grid is found in the picture."""
    grid: LensGrid | None = None
    """The whole grid, less exact; that of the transposed picture if the lenses have columns."""


def find_camera(data: bytes, name: str) -> Camera | None:
    """Returns the camera of a Lytro file `data`, or None for another picture. Raises `Unreadable` if its metadata
    aren't Lytro's.
    """
    if data.startswith(SIGNATURE):
        return read_camera(read_frame(data, name)[1], name)
    is_raw = len(data) in RAW_SENSORS and not find_by_signature(data)
    return Camera(Known(shape="hexagonal")) if is_raw else None


def read_camera(metadata: dict[str, Any], name: str) -> Camera:
    """Reads the lens array of a picture.

    The pitch is that of the lenses as the exit pupil casts them on the sensor; the origin lies in the picture's middle
    (UAM.Optics.LightField.Lytro's `MicroLensCollection`). Raises `Unreadable` if no lens array is described.
    """
    fields = Fields(metadata, name)
    shape = _SHAPES.get(fields.text("devices.mla.tiling"))
    if shape is None:
        raise Unreadable(f"{name}: its metadata describe no known lens array; give lens_pitch auto")
    pixel = fields.number("devices.sensor.pixelPitch") or math.inf
    pupil = fields.number("devices.lens.exitPupilOffset.z", 0.0) or math.inf
    cast = 1 + fields.number("devices.mla.sensorOffset.z", 0.0) / pupil
    scale_x, scale_y = (fields.number(f"devices.mla.scaleFactor.{axis}", 1.0) for axis in "xy")
    pitch = fields.number("devices.mla.lensPitch") / pixel * cast * scale_x
    stretch = scale_y / scale_x if scale_x else 0.0
    if not (LEAST_PITCH <= pitch <= MOST_PITCH and 0.9 < stretch < 1.1):
        raise Unreadable(f"{name}: its metadata describe lenses {pitch:.3g} pixels apart; give lens_pitch auto")
    offset = (
        fields.number("image.height") // 2 + fields.number("devices.mla.sensorOffset.y", 0.0) / pixel,
        fields.number("image.width") // 2 + fields.number("devices.mla.sensorOffset.x", 0.0) / pixel,
    )
    rotation = math.degrees(fields.number("devices.mla.rotation", 0.0))
    known = Known(shape=shape, stretch=stretch)
    if shape == "hexagonal-columns":
        offset, rotation, stretch = offset[::-1], -rotation, 1 / stretch
    grid = LensGrid(pitch, offset, rotation, "square" if shape == "square" else "hexagonal", stretch)
    size = fields.number("image.height"), fields.number("image.width")
    return _turn(known, grid, size, int(fields.number("image.orientation", 1)))


def _turn(known: Known, grid: LensGrid, size: tuple[float, float], orientation: int) -> Camera:
    """Turns the lens array as `pictures.decode` turns a picture of `size`: transposes it, then reverses its axes."""
    shape = known.shape
    if orientation in (5, 6, 7, 8):
        others: dict[KnownShape | None, KnownShape] = {
            "hexagonal": "hexagonal-columns",
            "hexagonal-columns": "hexagonal",
        }
        shape, size = others.get(shape, "square"), size[::-1]
        known = replace(known, shape=shape, stretch=1 / known.stretch)
        if shape == "square":
            grid = LensGrid(grid.pitch * grid.stretch, grid.offset[::-1], -grid.rotation, stretch=1 / grid.stretch)
    for axis, orientations in enumerate(((3, 4, 7, 8), (2, 3, 6, 7))):
        if orientation in orientations:
            offset = list(grid.offset)
            along = 1 - axis if shape == "hexagonal-columns" else axis
            offset[along] = size[axis] - 1 - offset[along]
            grid = replace(grid, offset=(offset[0], offset[1]), rotation=-grid.rotation)
    return Camera(known, grid)
