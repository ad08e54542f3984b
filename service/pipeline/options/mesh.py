"""Options of meshes: how they are rendered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.values import make_name, make_number

Backend = Literal["auto", "raster", "raytrace"]
Sampling = Literal["pinhole", "lenslet"]


MESH = {
    "backend": Option(
        "NAME",
        "what renders a mesh: raster (OpenGL), raytrace (Embree), or auto, the faster (default auto)",
        make_name(get_args(Backend)),
        "raytrace",
    ),
    "sampling": Option(
        "NAME",
        "how a lens sees a mesh: pinhole, one point; lenslet, the mean over its pitch (default pinhole)",
        make_name(get_args(Sampling)),
        "lenslet",
    ),
    "background": Option("RRGGBB", "colour behind a mesh (default 000000)", values.COLOUR, "ffffff"),
    "neighbour_time": Option(
        "SECONDS",
        "for a mesh: by how much the views around may prolong the job, as model auto predicts; 0: never (default 1)",
        make_number(0, 1e6, "seconds such as 0.5"),
        "0.5",
    ),
}
"""By name, in the order of the help. Pictures are refused with any of them."""


@dataclass(frozen=True)
class MeshOptions:
    """Values of the options in `MESH`."""

    backend: Backend = "auto"
    sampling: Sampling = "pinhole"
    background: tuple[int, int, int] = (0, 0, 0)
    """RGB, 0 to 255."""
    neighbour_time: float = 1.0
    """Seconds."""
