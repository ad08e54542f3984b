"""Makes a model of what an input shows, with coloured triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.focus.model import make_model
from ciir.service.pipeline.focus.light_fields import capture, find_depths
from ciir.service.pipeline.options import KINDS
from ciir.service.pipeline.report import Clock

if TYPE_CHECKING:
    from ciir.renderer.focus.model import Model
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source


def build_model(
    source: Source,
    options: Options,
    *,
    max_pixels: int | None = None,
    progress: Progress = ignore_progress,
    clock: Clock | None = None,
) -> tuple[Model, Report]:
    """Returns the model and the report. `progress` counts views, then the model.

    Raises the same errors as `service.pipeline.run.reconstruct`, and `InvalidOption`.
    """
    clock = clock or Clock()
    for name in ("view", "limits"):
        if getattr(options, name) is not None:
            raise InvalidOption(f"{name}: a model is made of several views; leave it out, or write a disparity map")
    captured = capture(
        source, options, max_pixels=max_pixels, progress=lambda done, total: progress(done, total + 1), clock=clock
    )
    array = captured.report["lens_array"]
    pitch = None if array["pitch"] is None else array["pitch"] / captured.scale
    cameras = None if options.camera_pitch is None else find_depths(options, captured.report, captured.scale)
    with clock.stage("focus"):
        field = captured.light_field if cameras is None else captured.light_field.with_depth_sense("cameras")
        model = make_model(field, pitch=pitch, delta=array["delta"], cameras=cameras)
    grid = array["pixels_v"] * array["pixels_u"]
    progress(grid + 1, grid + 1)
    report = captured.report | {
        "surface": {"vertices": len(model.vertices), "triangles": len(model.faces)},
        "options": options.as_dict(KINDS["disparity"].options),
        "notes": [*captured.report["notes"], *model.notes],
        "timings_ms": clock.timings_ms(),
    }
    return model, report
