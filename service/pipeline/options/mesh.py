"""Options of meshes: how they are placed and rendered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Self, get_args

from ciir.errors import InvalidOption
from ciir.renderer.placement import Fit, Placement, Up
from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.rotation import ROTATION, Rotation, list_yaws
from ciir.service.pipeline.options.values import make_angles, make_name, make_number

Backend = Literal["auto", "raster", "raytrace"]
Sampling = Literal["pinhole", "lenslet"]
Moment = dict[str, float]
"""A frame of a video of one view: its `time` in seconds, or its `yaw` in degrees."""


MESH = {
    "up": Option("AXIS", "the mesh's axis that points up: y, or z as in CAD (default y)", make_name(get_args(Up)), "z"),
    "rotate": Option(
        "YAW,PITCH,ROLL",
        "turns of a mesh in degrees, one after the other: yaw, its front to the right; pitch, its top towards the "
        "array; roll, its top to the left (default 0,0,0); several yaws, as START:STOP:COUNT, make a video of one "
        "view: 0:360:60 is a full turn",
        ROTATION,
        "30,20,0",
    ),
    "zoom": Option(
        "FACTOR",
        "size of a mesh, where 1 is as large as fits into every view (default 1)",
        make_number(0.01, 100),
        "1.5",
    ),
    "place": Option(
        "NUMBER",
        "where a mesh lies: -1 behind the lens array, 0 astride, 1 before it (default -1; in pictures for displays 0)",
        make_number(-1, 1),
        "0",
    ),
    "fit": Option(
        "NAME",
        "views: a mesh is made as large as fits into every view; none: its coordinates are those of the lens array, "
        "as those of a captured model (default views)",
        make_name(get_args(Fit)),
        "none",
    ),
    "light": Option(
        "AZIMUTH,ELEVATION",
        "where the light on a mesh comes from, in degrees: from the front to the right, -360 to 360, and up, -90 to 90 "
        "(default: about -30,37)",
        make_angles("AZIMUTH,ELEVATION", limits=(360, 90)),
        "60,20",
    ),
    "backend": Option(
        "NAME",
        "what renders a mesh: raster (OpenGL), raytrace (Embree), or auto, the faster (default auto)",
        make_name(get_args(Backend)),
        "raytrace",
    ),
    "sampling": Option(
        "NAME",
        "how a lens sees: pinhole, one point; lenslet, the mean over its pitch, also in pictures that were rendered "
        "so: what networks make is brought closer to these means (default pinhole; of other views it is found)",
        make_name(get_args(Sampling)),
        "lenslet",
    ),
    "background": Option(
        "RRGGBB", "colour behind a mesh, also #fff, white or black (default 000000)", values.COLOUR, "ffffff"
    ),
    "time": Option(
        "SECONDS",
        "moment of a glTF mesh's animation (default: as it is stored); several, as 0,0.5,1 or START:STOP:COUNT, make a "
        "video of one view",
        values.TIMES,
        "1.5",
    ),
    "animation": Option(
        "NAME",
        "with --time: the animation of a glTF mesh, its name or its number from 0 (default: the first, with those that "
        "move other parts)",
        values.LABEL,
        "0",
    ),
    "camera": Option(
        "NAME",
        "camera of a glTF mesh whose picture is framed: its name, or its number from 0",
        values.LABEL,
        "0",
    ),
    "neighbour_time": Option(
        "SECONDS",
        "for a mesh: by how much the views around may prolong the job, as model auto predicts; 0: never (default 1)",
        make_number(0, 1e6, "seconds such as 0.5"),
        "0.5",
    ),
}
"""By name, in the order of the help. Pictures are refused with any of them, but for `sampling` where they are
upscaled."""


@dataclass(frozen=True)
class MeshOptions:
    """Values of the options in `MESH`."""

    up: Up = "y"
    rotate: Rotation = (0.0, 0.0, 0.0)
    """Degrees; one yaw, or several for a video."""
    zoom: float = 1.0
    place: float | None = None
    """None: -1, or 0 in pictures for displays."""
    fit: Fit = "views"
    light: tuple[float, float] | None = None
    """Degrees."""
    backend: Backend = "auto"
    sampling: Sampling = "pinhole"
    background: tuple[int, int, int] = (0, 0, 0)
    """RGB, 0 to 255."""
    time: tuple[float, ...] | None = None
    """Seconds; one, or several for a video."""
    animation: str | None = None
    camera: str | None = None
    neighbour_time: float = 1.0
    """Seconds."""

    @property
    def placement(self) -> Placement:
        """What the options say of it. Raises `InvalidOption` where they contradict each other, and for several yaws."""
        if self.fit == "none" and self.place is not None:
            raise InvalidOption("fit, place: with fit none a mesh stays at its own place; leave one of them out")
        yaw, *others = list_yaws(self.rotate)
        if others:
            raise InvalidOption(
                f"rotate: {len(others) + 1} yaws make a video of one view, with reconstruct; give one yaw for anything "
                "else"
            )
        place = -1.0 if self.place is None else self.place
        rotate = yaw, *self.rotate[1:]
        return Placement(up=self.up, rotate=rotate, zoom=self.zoom, place=place, light=self.light, fit=self.fit)

    @property
    def moments(self) -> tuple[Moment, ...]:
        """What the frames of a video of one view show; none for one time and one yaw. Raises `InvalidOption`
        for several times and several yaws.
        """
        times, yaws = self.time or (), list_yaws(self.rotate)
        if len(times) > 1 and len(yaws) > 1:
            raise InvalidOption(
                f"rotate, time: {len(yaws)} yaws and {len(times)} times are given; give several of one, and one of the "
                "other"
            )
        if len(yaws) > 1:
            return tuple({"yaw": yaw} for yaw in yaws)
        return tuple({"time": time} for time in times) if len(times) > 1 else ()

    def select_moment(self, moment: Moment) -> Self:
        """The options of one of `moments`."""
        if "time" in moment:
            return replace(self, time=(moment["time"],))
        return replace(self, rotate=(moment["yaw"], *self.rotate[1:]))
