"""The rotation of a mesh: yaw, pitch and roll, or several yaws for a video of one view."""

from __future__ import annotations

from operator import index
from typing import Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.service.pipeline.options.values import ANGLE, MOST_FRAMES, check_number, make_angles, make_form, write_number

Rotation = tuple[float | tuple[float, float, int], float, float]
"""Yaw, pitch and roll in degrees. Several yaws are given as the first, the last and their count."""
_YAWS = f"{ANGLE}:{ANGLE}:[1-9][0-9]{{0,3}}"
_ANGLES = make_angles("YAW,PITCH,ROLL")


def list_yaws(rotation: Rotation) -> tuple[float, ...]:
    """Lists the yaws in degrees: one, or evenly spaced ones including both ends.

    For a full turn the last one is left out, because it equals the first.
    """
    yaw = rotation[0]
    if not isinstance(yaw, tuple):
        return (yaw,)
    start, stop, count = yaw
    is_full = start != stop and (stop - start) % 360 == 0
    return tuple(round(float(yaw), 6) for yaw in np.linspace(start, stop, count, endpoint=not is_full))


def _parse(name: str, text: str) -> Rotation:
    first, comma, others = text.partition(",")
    start, *rest = first.split(":")
    yaw, pitch, roll = _ANGLES.read(name, f"{start},{others if comma else '0,0'}")
    if not rest:
        return yaw, pitch, roll
    stop, count = float(rest[0]), int(rest[1])
    if count > MOST_FRAMES:
        raise InvalidOption(f"{name}: {count:,} yaws are over the limit of {MOST_FRAMES:,}; give fewer")
    return (yaw, stop, count), pitch, roll


def _convert(value: Any) -> Rotation:
    yaw, pitch, roll = value if hasattr(value, "__iter__") else (value, 0, 0)
    if not hasattr(yaw, "__iter__"):
        angles: Rotation = _ANGLES.convert((yaw, pitch, roll))
        return angles
    start, stop, count = map(check_number, yaw)
    if not 1 <= index(count) <= MOST_FRAMES:
        raise ValueError
    start, pitch, roll = _ANGLES.convert((start, pitch, roll))
    return (start, _ANGLES.convert((stop, 0, 0))[0], index(count)), pitch, roll


def _write(rotation: Rotation) -> str:
    yaw, *others = rotation
    first = ":".join(map(write_number, yaw)) if isinstance(yaw, tuple) else write_number(yaw)
    return ",".join([first, *map(write_number, others)])


ROTATION = make_form(
    f"({ANGLE}|{_YAWS})(,{ANGLE},{ANGLE})?",
    form="YAW,PITCH,ROLL in degrees, such as 30,-20,0 or 30, or several yaws as START:STOP:COUNT, such as 0:360:60",
    parse=_parse,
    convert=_convert,
    needed="YAW,PITCH,ROLL in degrees, such as (30, -20, 0) or 30, each below 1000, or several yaws such as '0:360:60'",
    write=_write,
)
