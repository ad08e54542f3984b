"""The shipped scenes from mesh to upscaled view: pictures for the README, and where the time goes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.models import catalogue
from ciir.renderer import scenes
from ciir.renderer.backends import open_backend
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.pictures import encode_png
from ciir.renderer.sampling import LENSLET_SAMPLES
from ciir.service.demo import contact_sheet
from ciir.service.pipeline import run as pipeline
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.report import STAGES

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels
    from ciir.service.pipeline.options import Backend
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.source import Source

SCENES = ("vase", "globe", "hamburger")
"""Of rising complexity, as in the field's papers; the last is followed step by step."""
LENSES, PIXELS = (100, 100), (15, 15)
COLUMNS = (*STAGES, "total")
WIDTH = 46


@dataclass(frozen=True)
class Step:
    """A line of the table of timings."""

    scene: str
    work: str
    report: Report


class _Kept:
    """Where pixels and their PNG go: a sink, and what `pipeline.elemental` calls."""

    pixels: Pixels
    png: bytes

    def begin(self, count: int) -> None:
        """One view is expected; `count` is of no matter."""

    def add(self, view: tuple[int, int], pixels: Pixels) -> str:  # noqa: ARG002 - there is one
        """Keeps a view."""
        self.keep(pixels)
        return "view.png"

    def keep(self, pixels: Pixels) -> None:
        """Encodes and keeps."""
        self.pixels, self.png = pixels, encode_png(pixels)

    def finish(self, report: Report) -> None:
        """Nothing is left to do."""


def run(write: Callable[[str, bytes], None], backend: Backend, tell: Callable[[Step], None]) -> None:
    """Gives `eia.png`, `view_before.png`, `view_after.png` (of the last scene) and `contact_sheet.png` to `write`.

    `tell` hears of each step when it is done. Lenses average over their pitch, as real ones do. Scenes, backend and
    network are made ready before anything is timed.
    """
    upscaler = catalogue.load(catalogue.DEFAULT)
    upscaler(np.zeros((1, 3, *LENSES), np.float32))
    open_backend(backend, rays=LENSES[0] * LENSES[1] * LENSLET_SAMPLES**2)
    mesh = Options(lenses=LENSES, pixels=PIXELS, backend=backend, sampling="lenslet")
    rows = []
    for scene in SCENES:
        scenes.load_scene(scene)
        eia = _Kept()
        made = pipeline.elemental(scene, mesh, eia.keep)
        tell(Step(scene, f"mesh of {made['input']['triangles']:,} triangles to EIA", made))
        picture = Bundle.from_upload(f"{scene}.png", eia.png)
        views = {}
        for model in ("none", "bicubic", catalogue.DEFAULT):
            views[model], report = _view(picture, Options(lenses=LENSES, model=model))
        tell(Step(scene, "EIA to view, upscaled", report))
        truth, report = _view(scene, replace(mesh, sampling="pinhole", strategy="direct"))
        tell(Step(scene, "mesh to view, direct", report))
        rows.append(
            contact_sheet.Row(scene, *(kept.pixels for kept in (*views.values(), truth)))  # mapped, bicubic, network
        )
    write("eia.png", eia.png)
    write("view_before.png", views["none"].png)
    write("view_after.png", views[catalogue.DEFAULT].png)
    write("contact_sheet.png", encode_png(contact_sheet.draw(rows, network=catalogue.DEFAULT)))


def _view(source: Source, options: Options) -> tuple[_Kept, Report]:
    kept = _Kept()
    return kept, pipeline.reconstruct(source, options, kept)


def header() -> str:
    """The first line of the table of timings."""
    return f"{'milliseconds':<{WIDTH}}" + "".join(f"{column:>9}" for column in COLUMNS)


def line(step: Step) -> str:
    """A step's line of the table."""
    timings = step.report["timings_ms"]
    cells = (f"{timings[column]:>9.1f}" if column in timings else f"{'':>9}" for column in COLUMNS)
    return f"{step.scene + ': ' + step.work:<{WIDTH}}" + "".join(cells)
