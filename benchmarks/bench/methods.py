"""The methods that produce a view of twice the resolution."""

from __future__ import annotations

import io
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ciir.benchmarks.bench.work import SCALE, reconstruct_views
from ciir.models import catalogue
from ciir.renderer.writers.file_writer import FileWriter
from ciir.service.pipeline.run import reconstruct

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from ciir.benchmarks.bench.work import Work

PAPER = "paper"
"""The paper's generator, with which times are compared."""
QUICK = "fast"
"""The quickest network, as float."""
DIRECT = "direct rendering"


@dataclass(frozen=True)
class Method:
    """One way to do the job: the options of `reconstruct` that select it."""

    name: str
    options: Mapping[str, Any]
    """The options that differ from the work's."""
    macs_per_output_pixel: float | None
    """Multiply-adds of the network; None if there is none."""
    kind: str
    """`interpolation`, `float network`, `int8 network`, `light-field network`, `nothing skipped` or `DIRECT`."""

    def suits(self, work: Work) -> bool:
        """Returns whether the method can do this work: only a mesh can be rendered."""
        return work.kind == "mesh" or self.kind != DIRECT

    def reconstruct(self, work: Work) -> tuple[NDArray[np.uint8], str | None]:
        """Returns the views of `work.truth` as this method computes them, `(n, H, W, 3)`, and the backend that
        rendered.
        """
        pictures, report = reconstruct_views(work.source, replace(work.options, **self.options))
        return pictures, report["plan"]["backend"]

    def time_job(self, work: Work) -> dict[str, float]:
        """Returns the milliseconds of each stage and in all (`total`) of one whole job: the centre view, from bytes to
        PNG.
        """
        options = replace(work.options, views="center", **self.options)
        begun = time.perf_counter()
        report = reconstruct(work.source, options, FileWriter(io.BytesIO(), None))
        total = 1e3 * (time.perf_counter() - begun)
        return {**report["timings_ms"], "total": total}


def list_methods() -> tuple[list[Method], dict[str, str]]:
    """Returns all methods, cheap ones first, and the networks that are left out: name -> reason."""
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
            found.append(Method(entry.name, {"model": entry.name}, cost, kind))
    quick = next(method for method in found if method.name == catalogue.prefer_int8(QUICK))
    options = {**quick.options, "skip": "none"}
    found.append(replace(quick, name=f"{quick.name}-whole", options=options, kind="nothing skipped"))
    found.sort(key=lambda method: (method.macs_per_output_pixel or 0.0, method.name != "nearest", method.name))
    for name, backend in (("direct-raster", "raster"), ("direct-rays", "raytrace")):
        found.append(Method(name, {"strategy": "direct", "backend": backend}, None, DIRECT))
    return found, left_out
