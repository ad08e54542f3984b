"""Develops the raw picture of a Lytro camera: unpacks and demosaics it, and applies its white balance, colours and
gamma.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from ciir.errors import Unreadable
from ciir.renderer.readers.lytro.container import read_frame
from ciir.renderer.readers.lytro.metadata import CELL, RAW_SENSORS, Sensor, read_sensor

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ciir.renderer.readers.pictures import Pixels

_ROWS = 128  # developed at a time


def decode(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Decodes a `.lfp` or `.lfr` file to RGB of 16 bit, and its orientation."""
    packed, metadata = read_frame(data, name)
    sensor = read_sensor(metadata, name)
    return develop(packed, sensor, name, check_size), sensor.orientation


def decode_raw(data: bytes, name: str, check_size: Callable[[int, int], None]) -> tuple[Pixels, int]:
    """Decodes a `.raw` file, which holds only pixels, with the levels of its camera and the colours of the sensor."""
    return develop(memoryview(data), RAW_SENSORS[len(data)], name, check_size), 1


def develop(packed: memoryview, sensor: Sensor, name: str, check_size: Callable[[int, int], None]) -> Pixels:
    """Returns the sensor's mosaic as RGB of 16 bit, `(H, W, 3)`, by bilinear interpolation."""
    height, width = sensor.height, sensor.width
    check_size(height, width)
    if height % 2 or width % 4:
        raise Unreadable(f"{name}: {height}x{width} pixels don't fill its packing; give the file again")
    if len(packed) < height * width * sensor.bits // 8:
        raise Unreadable(
            f"{name}: {height}x{width} pixels are cut off after {len(packed):,} bytes; give the whole file"
        )
    mosaic = unpack(packed, sensor)
    first = CELL.index(sensor.first)
    order = [CELL[(first // 2 + y) % 2 * 2 + (first + x) % 2] for y in (0, 1) for x in (0, 1)]
    levels = [
        (black, gain / (white - black))
        for black, white, gain in zip(sensor.black, sensor.white, sensor.gains, strict=True)
    ]
    to_srgb = np.array(sensor.to_srgb, np.float32).reshape(3, 3)
    developed = np.empty((height, width, 3), np.uint16)
    for top in range(0, height, _ROWS):
        start, stop = max(top - 2, 0), min(top + _ROWS + 2, height)
        light = np.empty((stop - start, width), np.float32)
        planes = np.zeros((3, stop - start, width), np.float32)
        for number, colour in enumerate(order):
            black, scale = levels[CELL.index(colour)]
            part = np.s_[number // 2 :: 2, number % 2 :: 2]
            light[part] = np.clip((mosaic[start:stop][part] - np.float32(black)) * np.float32(scale), 0, 1)
            planes["rgb".index("g" if colour[0] == "g" else colour)][part] = light[part]
        for plane, weights in zip(planes, (_SPARSE, _DENSE, _SPARSE), strict=True):
            plane[:] = ndimage.convolve(plane, weights, mode="mirror")
        rows = planes[:, top - start : min(top + _ROWS, height) - start]
        colours = np.clip(np.einsum("ij,jyx->yxi", to_srgb, rows), 0, 1) ** np.float32(sensor.gamma)
        developed[top : top + len(colours)] = np.rint(65535 * colours)
    return developed


_SPARSE = np.outer([0.5, 1, 0.5], [0.5, 1, 0.5]).astype(np.float32)  # red and blue: one pixel in four
_DENSE = np.array([[0, 0.25, 0], [0.25, 1, 0.25], [0, 0.25, 0]], np.float32)  # green: two in four


def unpack(packed: memoryview, sensor: Sensor) -> NDArray[np.uint16]:
    """Returns the mosaic, `(H, W)`.

    Two pixels of 12 bit are packed in three bytes, or four of 10 bit in five, the last of which has their low bits.
    """
    shape = sensor.height, sensor.width
    data = np.frombuffer(packed, np.uint8, shape[0] * shape[1] * sensor.bits // 8)
    mosaic = np.empty(shape[0] * shape[1], np.uint16)
    if sensor.bits == 12:
        first, middle, last = (data[number::3].astype(np.uint16) for number in range(3))
        mosaic[0::2], mosaic[1::2] = first << 4 | middle >> 4, (middle & 15) << 8 | last
    else:
        for number in range(4):
            mosaic[number::4] = data[number::5].astype(np.uint16) << 2 | data[4::5] >> 2 * number & 3
    return mosaic.reshape(shape)
