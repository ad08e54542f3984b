"""Makes jobs of the pipeline without files, and runs them."""

import json

import numpy as np

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.scenes import load_scene
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.pipeline.job import resolve_job
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct

SMALL = {"lenses": (12, 10), "pixels": (3, 5), "backend": "raytrace"}


def make_mesh_job(*, grid=(15, 15), wanted=None, name="vase", max_pixels=None, **options):
    """Makes a job for a shipped scene. `wanted`: views as (v, u), by default the centre view."""
    views = "center" if wanted is None else ";".join(f"{v},{u}" for v, u in wanted)
    asked = Options(**{"pixels": grid, "views": views} | options)
    return resolve_job("a.glb", load_scene(name), asked, max_views=10_000, max_pixels=max_pixels)


def make_light_field_job(*, grid=(2, 9), is_transparent=False, is_ordered=False, **options):
    """Makes a job for black views of one pixel."""
    views = np.zeros((*grid, 1, 1, 4 if is_transparent else 3), np.uint8)
    return resolve_job(
        "a.png", LightField(views, is_ordered=is_ordered), Options(**{"views": "0,0"} | options), max_views=10_000
    )


class Recorder(MemoryWriter):
    """Keeps the pixels, the announced contents, and the report."""

    begun = None
    report = None

    def begin(self, contents):
        self.begun = contents

    def finish(self, report):
        self.report = report


def run(source, **options):
    """Runs a reconstruction and returns the views as {(v, u): pixels}, and the report."""
    writer = Recorder()
    report = reconstruct(source, Options(**options), writer)
    assert writer.report == report
    assert len(writer.views) == len(report["views"])
    assert writer.begun.views == tuple(writer.views)
    for picture in writer.views.values():
        assert picture.shape == (writer.begun.height, writer.begun.width, writer.begun.channels)
        assert picture.dtype == writer.begun.dtype
    json.dumps(report, allow_nan=False)
    return writer.views, report


def eia_bundle(eia):
    return Bundle.from_upload("eia.png", encode_png(eia))
