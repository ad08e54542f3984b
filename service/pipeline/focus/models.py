"""Makes a model of what an input shows, with coloured triangles."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.backends.interface import BLACK
from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.focus.model import make_model
from ciir.renderer.scene import SOLID
from ciir.service.pipeline.focus.disparities import open_mesh
from ciir.service.pipeline.focus.light_fields import capture, find_depths
from ciir.service.pipeline.options import KINDS
from ciir.service.pipeline.report import Clock
from ciir.service.pipeline.source import Input
from ciir.service.pipeline.stages.object_check import HARDLY_SEEN

if TYPE_CHECKING:
    from ciir.renderer.focus.model import Model
    from ciir.service.pipeline.options import Options
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source

NO_BACKGROUND = "background: a model of a mesh has none; leave it out"
SEE_THROUGH = f"see-through materials are solid in a model where alpha is {SOLID} or more, and left out below"


def build_model(
    source: Source,
    options: Options,
    *,
    max_pixels: int | None = None,
    progress: Progress = ignore_progress,
    clock: Clock | None = None,
) -> tuple[Model, Report]:
    """Returns the model and the report. `progress` counts the views, and then the model, which counts as much
    as all of them.

    A mesh is rendered on black, and its depths are rendered too, not estimated.

    Raises the same errors as `service.pipeline.run.reconstruct`, and `InvalidOption`.
    """
    clock = clock or Clock()
    for name in ("view", "limits"):
        if getattr(options, name) is not None:
            raise InvalidOption(f"{name}: a model is made of several views; leave it out, or write a disparity map")
    is_mesh = Input(source).holds_mesh()
    captured = capture(
        source,
        replace(options, background=BLACK) if is_mesh else options,
        max_pixels=max_pixels,
        progress=lambda done, total: progress(done, 2 * total),
        clock=clock,
    )
    array = captured.report["lens_array"]
    grid = array["pixels_v"] * array["pixels_u"]
    pitch = None if array["pitch"] is None else array["pitch"] / captured.scale
    cameras = None if options.camera_pitch is None else find_depths(options, captured.report, captured.scale)
    notes = captured.report["notes"]
    find_depth = None
    if is_mesh:
        mesh, _, views = open_mesh(Input(source), options, clock)
        find_depth = views.render_depth
        notes = [note for note in notes if not note.startswith(HARDLY_SEEN)]
        notes += [NO_BACKGROUND] * (options.background != BLACK) + [SEE_THROUGH] * mesh.is_see_through
    with clock.stage("focus"):
        field = captured.light_field if cameras is None else captured.light_field.with_depth_sense("cameras")
        model = make_model(
            field,
            pitch=pitch,
            delta=array["delta"],
            cameras=cameras,
            find_depth=find_depth,
            progress=lambda done, total: progress(grid + grid * done // total, 2 * grid),
        )
    progress(2 * grid, 2 * grid)
    report = captured.report | {
        "surface": {"vertices": len(model.vertices), "triangles": len(model.faces)},
        "options": options.as_dict(KINDS["disparity"].options),
        "notes": [*notes, *model.notes],
        "timings_ms": clock.timings_ms(),
    }
    return model, report
