"""Makes the demo: the shipped scenes from mesh to upscaled views, with the time of each stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.models import catalogue
from ciir.renderer import scenes
from ciir.renderer.backends import open_backend
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.demo import contact_sheet
from ciir.service.pipeline.elemental import encode_eia, render_eia
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.report import STAGES
from ciir.service.pipeline.run import reconstruct

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.service.demo.contact_sheet import Row
    from ciir.service.pipeline.options import Backend
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

SCENES = ("vase", "globe", "hamburger")
"""In order of rising complexity. The pictures of single steps show the last."""
LENSES, PIXELS = (100, 100), (9, 9)
COLUMNS = (*(stage for stage in STAGES if stage != "focus"), "total")
WIDTH = 46


@dataclass(frozen=True)
class Step:
    """A line of the table of timings."""

    scene: str
    work: str
    report: Report


class PngWriter(MemoryWriter):
    """Keeps each view's pixels, and encodes them as PNG into `files`, so that the time for encoding counts."""

    def __init__(self) -> None:
        super().__init__()
        self.files: dict[View, bytes] = {}

    def write(self, view: View, pixels: Pixels) -> str:
        """Encodes and keeps the view."""
        self.files[view] = encode_png(pixels)
        return super().write(view, pixels)


def run_demo(
    write: Callable[[str, bytes], None], backend: Backend, report_step: Callable[[Step], None]
) -> tuple[Row, ...]:
    """Passes `eia.png`, `view_before.png`, `view_after.png` (of the last scene) and `contact_sheet.png` to `write`, and
    returns the pictures made from each scene.

    `report_step` is called after each step. Scenes, backend and networks are loaded before the first step is timed.
    """
    single = catalogue.load_upscaler(catalogue.picture_default_name())
    single(np.zeros((1, 3, *LENSES), np.float32))
    catalogue.load_light_field_network(catalogue.light_field_default_name())
    open_backend(backend, rays=LENSES[0] * LENSES[1] * LENSLET_SAMPLES**2)
    for scene in SCENES:
        scenes.load_scene(scene)
    rows = []
    for scene in SCENES:
        row, files = _make(scene, backend, report_step)
        rows.append(row)
    for name, data in files.items():
        write(name, data)
    write("contact_sheet.png", encode_png(contact_sheet.draw(rows)))
    return tuple(rows)


def _make(scene: str, backend: Backend, report_step: Callable[[Step], None]) -> tuple[Row, dict[str, bytes]]:
    """Returns the pictures made from a scene, and the files of its single steps by file name."""
    mesh = Options(lenses=LENSES, pixels=PIXELS, backend=backend, sampling="lenslet")
    eias: list[bytes] = []
    made = render_eia(scene, mesh, lambda pixels: eias.append(encode_eia(pixels, mesh)))
    report_step(Step(scene, f"mesh of {made['input']['triangles']:,} triangles to EIA", made))
    eia = Bundle.from_upload(f"{scene}.png", eias[0])
    centre = PIXELS[0] // 2, PIXELS[1] // 2
    single_model = catalogue.picture_default_name()
    mapped, _ = _reconstruct(eia, Options(lenses=LENSES, model="none"))
    bicubic, _ = _reconstruct(eia, Options(lenses=LENSES, model="bicubic"))
    single, report = _reconstruct(eia, Options(lenses=LENSES, model=single_model))
    report_step(Step(scene, f"EIA to view by {single_model}", report))
    views, report = _reconstruct(eia, Options(lenses=LENSES, views="all"))
    default_model = report["plan"]["model"]
    report_step(Step(scene, f"EIA to {len(views.views)} views by {default_model}", report))
    shown = Options(
        lenses=LENSES, pixels=PIXELS, backend=backend, strategy="direct", views=f"0,0;{centre[0]},{centre[1]}"
    )
    truth, report = _reconstruct(scene, shown)
    report_step(Step(scene, f"mesh to {len(truth.views)} views, direct", report))
    row = contact_sheet.Row(
        scene,
        mapped=mapped.views[centre],
        bicubic=bicubic.views[centre],
        single=single.views[centre],
        views=views.views,
        truth=truth.views,
        single_model=single_model,
        default_model=default_model,
    )
    return row, {"eia.png": eias[0], "view_before.png": mapped.files[centre], "view_after.png": views.files[centre]}


def _reconstruct(source: Source, options: Options) -> tuple[PngWriter, Report]:
    """Returns the views and the report."""
    with PngWriter() as writer:
        report = reconstruct(source, options, writer)
    return writer, report


def format_header() -> str:
    """Returns the first line of the table of timings."""
    return f"{'milliseconds':<{WIDTH}}" + "".join(f"{column:>9}" for column in COLUMNS)


def format_step(step: Step) -> str:
    """Returns a step's line of the table."""
    timings = step.report["timings_ms"]
    cells = (f"{timings[column]:>9.1f}" if column in timings else f"{'':>9}" for column in COLUMNS)
    return f"{step.scene + ': ' + step.work:<{WIDTH}}" + "".join(cells)


def format_result(row: Row) -> str:
    """Returns a line on a scene: which model made what, and its Y-PSNR compared with the other ways."""
    _, bicubic, single, default = row.score_all()
    return (
        f"{row.scene}: {len(row.views)} views by {row.default_model}, the centre view {default}: "
        f"{default.psnr - bicubic.psnr:+.2f} dB against bicubic, {default.psnr - single.psnr:+.2f} dB against "
        f"{row.single_model}"
    )
