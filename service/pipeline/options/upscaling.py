"""Options of the output: which views, which model, and how large."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from ciir.models.catalogue import FALLBACK, LIGHT_FIELD_DEFAULT
from ciir.models.light_field.fusion import Fusion
from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.values import make_integer, make_name, make_switch

Strategy = Literal["upscale", "direct", "auto"]
Skip = Literal["exact", "none"]


AUTO, NO_MODEL = "auto", "none"
"""Values of `model` besides the names in the catalogue: select a model automatically, and write the views unchanged."""
AUTO_MODEL = (
    f"{LIGHT_FIELD_DEFAULT} for a mesh (within the neighbour time) and for grids of 3x3 views and up; {FALLBACK} for "
    "other views and for pictures; their int8 twins if the processor supports them"
)
"""The rule of `auto`. `service.pipeline.planning.model_selection` applies it."""
MAX_SCALE = 8
OTHER_SCALES = (
    "the shipped networks upscale by 2 only: for 4, upscale the result again, and for others give model bicubic"
)
"""What to do for a scale that the networks don't have."""

UPSCALING = {
    "views": Option(
        "SPEC",
        "views to make: center, cross, all, or pairs of row and column such as '0,0 7,7' (default center)",
        values.VIEWS,
        "cross",
    ),
    "model": Option(
        "NAME",
        "a network or interpolation that `ciir models` lists; none to write views as they are; or auto: "
        f"{AUTO_MODEL} (default auto)",
        values.TEXT,
        "auto",
    ),
    "scale": Option(
        "S",
        f"output pixels for each view pixel along a side, 1 to {MAX_SCALE} (default 2); {OTHER_SCALES}",
        make_integer(1, MAX_SCALE),
        "2",
    ),
    "strategy": Option(
        "NAME",
        "upscale: upscale the views; direct: render a mesh at the larger size; auto: the faster one (default upscale)",
        make_name(get_args(Strategy)),
        "auto",
    ),
    "fusion": Option(
        "NAME",
        "whether an upscaled view of a light field becomes the mean of itself and its upscaled neighbours, which is "
        "closer to the truth and takes longer: always; never; or auto, for views of at most 100,000 pixels that look "
        "filtered or are of an array that is a JPEG (default auto)",
        make_name(get_args(Fusion)),
        "always",
    ),
    "skip": Option(
        "NAME",
        "exact: skip triangles and pixels that can't change the result; none: compute everything (default exact)",
        make_switch(get_args(Skip)),
        "none",
    ),
}
"""Options by name, in the order of the help."""


@dataclass(frozen=True)
class UpscalingOptions:
    """Values of the options in `UPSCALING`."""

    views: str = "center"
    model: str = AUTO
    scale: int = 2
    strategy: Strategy = "upscale"
    fusion: Fusion = "auto"
    skip: Skip = "exact"
