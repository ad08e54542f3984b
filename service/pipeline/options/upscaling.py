"""Options of the output: which views, by which model, how large."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from ciir.models.catalogue import DEFAULT, LIGHT_FIELD_DEFAULT
from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.values import make_integer, make_name, make_switch

Strategy = Literal["upscale", "direct", "auto"]
Skip = Literal["exact", "none"]


AUTO, NO_MODEL = "auto", "none"
"""Values of `model` beside the names of the catalogue: select the model; write views as they were made."""
AUTO_MODEL = (
    f"{LIGHT_FIELD_DEFAULT} for views of a grid of 3x3 and up (of a mesh: within the neighbour time), else {DEFAULT}; "
    "their int8 twins where the processor supports them"
)
"""The rule of `auto` in words; `service.pipeline.planning.model_selection` applies it."""
MAX_SCALE = 8

UPSCALING = {
    "views": Option(
        "SPEC",
        "center, cross, all, or pairs of row and column like '0,0;7,7' (default center)",
        values.VIEWS,
        "cross",
    ),
    "model": Option(
        "NAME",
        f"a model that `ciir models` lists, none to write views as they are, or auto: {AUTO_MODEL} (default auto)",
        values.TEXT,
        "auto",
    ),
    "scale": Option(
        "S", "output pixels for each view pixel along a side, 1 to 8 (default 2)", make_integer(1, MAX_SCALE), "2"
    ),
    "strategy": Option(
        "NAME",
        "upscale: upscale the views; direct: render a mesh at the larger size; auto: the faster one (default upscale)",
        make_name(get_args(Strategy)),
        "auto",
    ),
    "skip": Option(
        "NAME",
        "exact: skip triangles and pixels that can't change the result; none: compute everything (default exact)",
        make_switch(get_args(Skip)),
        "none",
    ),
}
"""By name, in the order of the help."""


@dataclass(frozen=True)
class UpscalingOptions:
    """Values of the options in `UPSCALING`."""

    views: str = "center"
    model: str = AUTO
    scale: int = 2
    strategy: Strategy = "upscale"
    skip: Skip = "exact"
