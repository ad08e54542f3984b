"""Jobs of the pipeline without files."""

import numpy as np

from ciir.renderer.light_field import LightField
from ciir.renderer.scenes import load_scene
from ciir.service.pipeline.job import resolve_job
from ciir.service.pipeline.options import Options


def make_mesh_job(*, grid=(15, 15), wanted=None, name="vase", max_pixels=None, **options):
    """A job for a shipped scene; `wanted`: views as (v, u), the centre view by default."""
    views = "center" if wanted is None else ";".join(f"{v},{u}" for v, u in wanted)
    asked = Options(**{"pixels": grid, "views": views} | options)
    return resolve_job("a.glb", load_scene(name), asked, max_views=10_000, max_pixels=max_pixels)


def make_light_field_job(*, grid=(2, 9), is_transparent=False, is_ordered=False, **options):
    """A job for black views of one pixel."""
    views = np.zeros((*grid, 1, 1, 4 if is_transparent else 3), np.uint8)
    return resolve_job(
        "a.png", LightField(views, is_ordered=is_ordered), Options(**{"views": "0,0"} | options), max_views=10_000
    )
