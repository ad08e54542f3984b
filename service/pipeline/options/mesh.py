"""Options of meshes: how they are placed and rendered."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any, Literal, Self, get_args

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.placement import FACTORS, Fit, Placement, Up
from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.rotation import ROTATION, Rotation, list_yaws
from ciir.service.pipeline.options.values import (
    MOST_FRAMES,
    ValueType,
    check_number,
    convert_whole_numbers,
    make_angles,
    make_form,
    make_name,
    make_number,
    write_number,
)

Backend = Literal["auto", "raster", "raytrace"]
Sampling = Literal["pinhole", "lenslet"]
Moment = dict[str, float]
"""A frame in a video of one view: its `time` in seconds, or its `yaw` in degrees."""
_SECONDS = r"[0-9]{1,6}(\.[0-9]{1,9})?"
_NAMED_COLOURS = {
    "aqua": "0ff", "black": "000", "blue": "00f", "fuchsia": "f0f", "gray": "808080", "green": "008000", "lime": "0f0",
    "maroon": "800000", "navy": "000080", "olive": "808000", "purple": "800080", "red": "f00", "silver": "c0c0c0",
    "teal": "008080", "white": "fff", "yellow": "ff0",
}  # fmt: skip
"""The basic colours of CSS (CSS Color Module Level 4, 6.1)."""
_COLOUR = f"#?([0-9a-fA-F]{{3}}){{1,2}}|{'|'.join(_NAMED_COLOURS)}"


def _read_colour(name: str, text: str) -> tuple[int, int, int]:
    bare = text.strip().lower()
    if re.fullmatch(_COLOUR, bare) is None:
        raise InvalidOption(
            f"{name}: {text[:40]!r} is not an opaque colour; give RRGGBB in hexadecimal, such as 00ff00, or a name, "
            "such as lime (nothing is transparent: give a colour that can be keyed out)"
        )
    digits = _NAMED_COLOURS.get(bare, bare.removeprefix("#"))
    red, green, blue = bytes.fromhex("".join(digit * 2 for digit in digits) if len(digits) == 3 else digits)
    return red, green, blue


def _parse_times(name: str, times: str) -> tuple[float, ...]:
    if ":" in times:
        start, stop, count = times.split(":")
        found = _space_evenly(float(start), float(stop), min(int(count), MOST_FRAMES + 1))
    else:
        found = tuple(map(float, times.split(",")))
    if len(found) > MOST_FRAMES:
        raise InvalidOption(f"{name}: more than {MOST_FRAMES:,} times are given; give fewer")
    return found


def _space_evenly(start: float, stop: float, count: int) -> tuple[float, ...]:
    """Returns `count` times from `start` to `stop`, both included, to a nanosecond."""
    return tuple(round(float(time), 9) for time in np.linspace(start, stop, count))


def _convert_times(value: Any) -> tuple[float, ...]:
    times = tuple(round(float(check_number(time)), 9) for time in (value if hasattr(value, "__iter__") else [value]))
    if not 0 < len(times) <= MOST_FRAMES or not all(0 <= time < 1e6 for time in times):
        raise ValueError
    return times


def _write_times(times: tuple[float, ...]) -> str:
    texts = [write_number(time, 9) for time in times]
    is_even = len(times) > 2 and times == _space_evenly(times[0], times[-1], len(times))
    return f"{texts[0]}:{texts[-1]}:{len(times)}" if is_even else ",".join(texts)


COLOUR = ValueType(
    {"type": "string", "pattern": f"^({_COLOUR})?$"},
    _read_colour,
    lambda value: convert_whole_numbers(value, 3, 255),
    "red, green and blue from 0 to 255, such as (255, 255, 255)",
    lambda colour: "{:02x}{:02x}{:02x}".format(*colour),
)
TIMES = make_form(
    f"{_SECONDS}(,{_SECONDS})*|{_SECONDS}:{_SECONDS}:[1-9][0-9]{{0,3}}",
    form="seconds such as 1.5, several as 0,0.5,1, or START:STOP:COUNT such as 0:2:48",
    parse=_parse_times,
    convert=_convert_times,
    needed="seconds such as 1.5, or several such as (0, 0.5, 1)",
    write=_write_times,
)
MESH = {
    "up": Option(
        "AXIS",
        "the mesh's axis that points up: y, or z as in CAD (default y)",
        replace(make_name(get_args(Up)), read=lambda _, text: text.strip().lower()),
        "z",
    ),
    "rotate": Option(
        "YAW,PITCH,ROLL",
        "turn a mesh by these angles in degrees, one after the other: yaw turns its front to the right, pitch its top "
        "towards the array, roll its top to the left (default 0,0,0; 30 alone is a yaw); several yaws, given as "
        "START:STOP:COUNT, make a video of one view: 0:360:60 is a full turn",
        ROTATION,
        "30,20,0",
    ),
    "zoom": Option(
        "FACTOR",
        "size of a mesh; 1 is the largest size that fits into every view (default 1)",
        make_number(*FACTORS),
        "1.5",
    ),
    "place": Option(
        "NUMBER",
        "position of a mesh: -1 behind the lens array, 0 centred on it, 1 in front of it (default -1; for displays 0)",
        make_number(-1, 1),
        "0",
    ),
    "depth_factor": Option(
        "FACTOR",
        "factor on a mesh's depth from the plane of the lens array or display, at the same size; below 1 it is flatter "
        "(default 1)",
        make_number(*FACTORS),
        "0.5",
    ),
    "fit": Option(
        "NAME",
        "views: scale a mesh to the largest size that fits into every view; none: take its coordinates as those of the "
        "lens array, as for a captured 3D model (default views)",
        make_name(get_args(Fit)),
        "none",
    ),
    "light": Option(
        "AZIMUTH,ELEVATION",
        "direction from which a mesh is lit, in degrees: from the front to the right, -360 to 360, and up, -90 to 90 "
        "(default: about -30,37)",
        make_angles("AZIMUTH,ELEVATION", limits=(360, 90)),
        "60,20",
    ),
    "backend": Option(
        "NAME",
        "renderer for a mesh: raster (OpenGL), raytrace (Embree), or auto, the faster one (default auto)",
        make_name(get_args(Backend)),
        "raytrace",
    ),
    "sampling": Option(
        "NAME",
        "what a lens sees: pinhole, one point; lenslet, the mean over its pitch; give lenslet also for pictures that "
        "were rendered this way, so that the views made by networks are brought closer to these means (default "
        "pinhole; detected for other views)",
        make_name(get_args(Sampling)),
        "lenslet",
    ),
    "background": Option(
        "RRGGBB",
        "colour behind a mesh: 00ff00, #0f0, or a name such as lime (default 000000); none is transparent",
        COLOUR,
        "ffffff",
    ),
    "time": Option(
        "SECONDS",
        "time in a glTF mesh's animation (default: the mesh as it is stored); several, given as 0,0.5,1 or "
        "START:STOP:COUNT, make a video of one view",
        TIMES,
        "1.5",
    ),
    "animation": Option(
        "NAME",
        "with --time: the glTF mesh's animation, by its name or its number from 0 (default: the first, together with "
        "those that move other parts)",
        values.LABEL,
        "0",
    ),
    "camera": Option(
        "NAME",
        "frame the picture of this camera of a glTF mesh: its name, or its number from 0",
        values.LABEL,
        "0",
    ),
    "neighbour_time": Option(
        "SECONDS",
        "for a mesh and a network that takes several views: by how many seconds the job may take longer, as "
        "predicted for a typical machine, to render views through a moved lens array, or else their neighbours (for a "
        "video: each frame); 0: neither (default 1)",
        make_number(0, 1e6, "seconds such as 0.5"),
        "0.5",
    ),
}
"""Options by name, in the order of the help. A picture is refused with any of them, except that `sampling` is allowed
if the picture is upscaled."""


@dataclass(frozen=True)
class MeshOptions:
    """Values of the options in `MESH`."""

    up: Up = "y"
    rotate: Rotation = (0.0, 0.0, 0.0)
    """Degrees. One yaw, or several for a video."""
    zoom: float = 1.0
    place: float | None = None
    """None stands for -1, or for 0 in display pictures."""
    depth_factor: float = 1.0
    fit: Fit = "views"
    light: tuple[float, float] | None = None
    """Degrees."""
    backend: Backend = "auto"
    sampling: Sampling = "pinhole"
    background: tuple[int, int, int] = (0, 0, 0)
    """RGB, 0 to 255."""
    time: tuple[float, ...] | None = None
    """Seconds. One time, or several for a video."""
    animation: str | None = None
    camera: str | None = None
    neighbour_time: float = 1.0
    """Seconds."""

    @property
    def placement(self) -> Placement:
        """The placement given by the options.

        Raises `InvalidOption` if they contradict each other, and for several yaws.
        """
        if self.fit == "none" and self.place is not None:
            raise InvalidOption("fit, place: with fit none a mesh stays at its own place; leave one of them out")
        yaw, *others = list_yaws(self.rotate)
        if others:
            raise InvalidOption(
                f"rotate: {len(others) + 1} yaws make a video of one view, with `ciir reconstruct`; give one yaw for "
                "anything else"
            )
        place = -1.0 if self.place is None else self.place
        rotate = yaw, *self.rotate[1:]
        return Placement(
            up=self.up,
            rotate=rotate,
            zoom=self.zoom,
            place=place,
            depth_factor=self.depth_factor,
            light=self.light,
            fit=self.fit,
        )

    @property
    def moments(self) -> tuple[Moment, ...]:
        """The frames of a video of one view; empty for one time and one yaw.

        Raises `InvalidOption` for several times together with several yaws.
        """
        times, yaws = self.time or (), list_yaws(self.rotate)
        if len(times) > 1 and len(yaws) > 1:
            raise InvalidOption(
                f"rotate, time: {len(yaws)} yaws and {len(times)} times are given; give several of only one of the two"
            )
        if len(yaws) > 1:
            return tuple({"yaw": yaw} for yaw in yaws)
        return tuple({"time": time} for time in times) if len(times) > 1 else ()

    def select_moment(self, moment: Moment) -> Self:
        """Returns the options for one of `moments`."""
        if "time" in moment:
            return replace(self, time=(moment["time"],))
        return replace(self, rotate=(moment["yaw"], *self.rotate[1:]))
