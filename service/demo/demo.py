"""Makes the demo: the shipped scenes from mesh to upscaled view, with the time of each stage."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ciir.models import catalogue
from ciir.renderer import scenes
from ciir.renderer.backends import open_backend
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.pictures import decode
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.renderer.writers.formats import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.demo import contact_sheet
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.report import STAGES
from ciir.service.pipeline.run import reconstruct, render_eia

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels
    from ciir.service.pipeline.options import Backend
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

SCENES = ("vase", "globe", "hamburger")
"""Of rising complexity; the pictures of single steps are of the last."""
LENSES, PIXELS = (100, 100), (15, 15)
COLUMNS = (*STAGES, "total")
WIDTH = 46


@dataclass(frozen=True)
class Step:
    """A line of the table of timings."""

    scene: str
    work: str
    report: Report


def run_demo(write: Callable[[str, bytes], None], backend: Backend, report_step: Callable[[Step], None]) -> None:
    """Gives `eia.png`, `view_before.png`, `view_after.png` (of the last scene) and `contact_sheet.png` to `write`.

    `report_step` is called after each step. Scenes, backend and network are loaded before the first step is timed.
    """
    upscaler = catalogue.load_upscaler(catalogue.DEFAULT)
    upscaler(np.zeros((1, 3, *LENSES), np.float32))
    open_backend(backend, rays=LENSES[0] * LENSES[1] * LENSLET_SAMPLES**2)
    mesh = Options(lenses=LENSES, pixels=PIXELS, backend=backend, sampling="lenslet")
    rows = []
    for scene in SCENES:
        scenes.load_scene(scene)
        eias: list[bytes] = []
        made = render_eia(scene, mesh, partial(_keep_png, eias))
        report_step(Step(scene, f"mesh of {made['input']['triangles']:,} triangles to EIA", made))
        picture = Bundle.from_upload(f"{scene}.png", eias[0])
        views = {}
        for model in ("none", "bicubic", catalogue.DEFAULT):
            views[model], report = _view(picture, Options(lenses=LENSES, model=model))
        report_step(Step(scene, "EIA to view, upscaled", report))
        truth, report = _view(scene, replace(mesh, sampling="pinhole", strategy="direct"))
        report_step(Step(scene, "mesh to view, direct", report))
        pixels = [decode(png, name=scene) for png in (*views.values(), truth)]
        rows.append(contact_sheet.Row(scene, *pixels))  # mapped, bicubic, network, truth
    write("eia.png", eias[0])
    write("view_before.png", views["none"])
    write("view_after.png", views[catalogue.DEFAULT])
    write("contact_sheet.png", encode_png(contact_sheet.draw(rows, network=catalogue.DEFAULT)))


def _keep_png(kept: list[bytes], pixels: Pixels) -> None:
    kept.append(encode_png(pixels))


def _view(source: Source, options: Options) -> tuple[bytes, Report]:
    """The centre view as a PNG, and the report."""
    file = io.BytesIO()
    with FileWriter(file, "png") as writer:
        report = reconstruct(source, options, writer)
    return file.getvalue(), report


def format_header() -> str:
    """The first line of the table of timings."""
    return f"{'milliseconds':<{WIDTH}}" + "".join(f"{column:>9}" for column in COLUMNS)


def format_step(step: Step) -> str:
    """A step's line of the table."""
    timings = step.report["timings_ms"]
    cells = (f"{timings[column]:>9.1f}" if column in timings else f"{'':>9}" for column in COLUMNS)
    return f"{step.scene + ': ' + step.work:<{WIDTH}}" + "".join(cells)
