"""Options of meshes: how they are placed and rendered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Self, get_args

from ciir.errors import InvalidOption
from ciir.renderer.placement import FACTORS, Fit, Placement, Up
from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.rotation import ROTATION, Rotation, list_yaws
from ciir.service.pipeline.options.values import make_angles, make_name, make_number

Backend = Literal["auto", "raster", "raytrace"]
Sampling = Literal["pinhole", "lenslet"]
Moment = dict[str, float]
"""A frame in a video of one view: its `time` in seconds, or its `yaw` in degrees."""


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
        values.COLOUR,
        "ffffff",
    ),
    "time": Option(
        "SECONDS",
        "time in a glTF mesh's animation (default: the mesh as it is stored); several, given as 0,0.5,1 or "
        "START:STOP:COUNT, make a video of one view",
        values.TIMES,
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
