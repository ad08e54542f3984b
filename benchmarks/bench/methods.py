"""The ways to a view of twice the resolution."""

from __future__ import annotations

import io
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ciir.benchmarks.bench.work import SCALE, views_and_report
from ciir.models import catalogue
from ciir.renderer.writers.formats import FileWriter
from ciir.service.pipeline.run import reconstruct

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from ciir.benchmarks.bench.work import Work

PAPER = "paper"
"""The network that ratios refer to: the paper's generator."""
WORDS = {
    "nearest": "pixel mapping alone, each pixel repeated",
    "bicubic": "bicubic interpolation",
    "direct-raster": "rendered at the target's resolution by OpenGL",
    "direct-rays": "rendered at the target's resolution by rays: the truth itself",
}


@dataclass(frozen=True)
class Method:
    """Options that make `reconstruct` do the job in one way."""

    name: str
    what: str
    """In words."""
    options: Mapping[str, Any]
    """What differs from the work's options."""
    macs_per_output_pixel: float | None
    """Multiply-adds of the network; None where there is none."""
    kind: str
    """`interpolation`, `float network`, `int8 network`, `light-field network`, `nothing skipped` or
    `direct rendering`."""

    def suits(self, work: Work) -> bool:
        """Whether it can do this work."""
        return work.kind == "mesh" or self.kind != "direct rendering"

    def made(self, work: Work) -> tuple[NDArray[np.uint8], str | None]:
        """What comes out, `(n, H, W, 3)`, for the views of `work.truth`; and what rendered a mesh, which `auto` chooses
        by triangles and samples."""
        pictures, report = views_and_report(work.source, replace(work.options, **self.options))
        return pictures, report["plan"]["backend"]

    def job(self, work: Work) -> dict[str, float]:
        """One whole job, the centre view from bytes to encoded PNG: milliseconds of each stage and of all by the
        wall clock (`total`)."""
        asked = replace(work.options, views="center", **self.options)
        begun = time.perf_counter()
        report = reconstruct(work.source, asked, FileWriter(io.BytesIO(), None))
        total = 1e3 * (time.perf_counter() - begun)
        return {**report["timings_ms"], "total": total}


def methods() -> tuple[list[Method], dict[str, str]]:
    """All methods, cheap ones first, and the networks that are left out: name -> why."""
    found: list[Method] = []
    left_out: dict[str, str] = {}
    for entry in catalogue.list_entries():
        if SCALE not in entry.scales:
            left_out[entry.name] = f"upscales by {entry.scales}, not by {SCALE}"
        elif entry.unsupported_reason:
            left_out[entry.name] = entry.unsupported_reason
        else:
            card = entry.card
            kind = "interpolation" if card is None else "int8 network" if card.precision == "int8" else "float network"
            kind = "light-field network" if entry.is_light_field else kind
            cost = card.macs_per_output_pixel if card is not None else None
            found.append(Method(entry.name, WORDS.get(entry.name, entry.kind), {"model": entry.name}, cost, kind))
    default = next(method for method in found if method.name == catalogue.default_name())
    whole = replace(
        default,
        name=f"{default.name}-whole",
        what="the default with nothing skipped (`--skip none`)",
        options={**default.options, "skip": "none"},
        kind="nothing skipped",
    )
    found.append(whole)
    found.sort(key=lambda method: (method.macs_per_output_pixel or 0.0, method.name != "nearest", method.name))
    for name, backend in (("direct-raster", "raster"), ("direct-rays", "raytrace")):
        options = {"strategy": "direct", "backend": backend}
        found.append(Method(name, WORDS[name], options, None, "direct rendering"))
    return found, left_out
