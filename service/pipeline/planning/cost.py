"""Predicts how long this machine takes to render, upscale and write views, for `auto`.

Times are linear in triangles, rays, pixels and views. Typical coefficients are scaled to this machine by one short run
of each backend and of each network, when a prediction first needs it. The results are kept in the cache folder.
Predictions that need not be exact use the typical coefficients if there is no measurement yet.
"""

from __future__ import annotations

import json
import math
import platform
import sys
import threading
import time
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.cores import count_available_cores
from ciir.models import catalogue, processor
from ciir.models.light_field.views import upscale_views
from ciir.models.single.pixels import upscale_pixels
from ciir.renderer import backends
from ciir.renderer.backends import culling
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene
from ciir.renderer.writers.atomic_write import replacing
from ciir.service.pipeline import cache_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

JOB_MS, OPENGL_START_MS, NETWORK_START_MS = 2.0, 200.0, 60.0
"""Cost of any job, of the first view by OpenGL, and of the first network in a process. Typical values, not measured."""
PLACE_MS, LOOK_MS, HIT = 1e-4, 3.3e-5, 1.25
"""Culling: cost for each triangle, and for each triangle in each view; triangles that remain for each ray."""
WRITE_MS = 1.2e-5
"""Cost for each pixel of a PNG."""
VIEW_PIXELS, CALL_PIXELS = 200, 600
"""Fixed costs of a network, in pixels that take as long: for each view, and for each call."""
SIDE, VIEWS = 64, 7
"""Pixels along a side of the views in a measurement, and the number of views."""
ROUNDS, LEAST_MS = 5, 100.0
"""The least number of rounds of a measurement, and its least duration."""
TYPICAL_MAC_MS = {"float32": 2e-8, "int8": 1e-8}
"""Cost of a network's multiply-add on a typical machine, by precision."""
TYPICAL_INTERPOLATION_MS = 1e-4
"""Cost of one interpolated pixel."""


class Stage(NamedTuple):
    """Milliseconds of a stage of the pipeline."""

    once: float
    """Time before its first view."""
    views: float
    """Time for all views, while no other stage runs."""
    cores: int = 1
    """Number of cores that it keeps busy."""


class Rendering(NamedTuple):
    """Views of a new scene, with `rays` rays each."""

    backend: str
    triangles: int
    rays: int
    views: int
    texels: int = 0
    """Texels in all textures."""
    textured: float = 0.0
    """Share of the triangles that have a texture."""
    culls: bool = False
    """Whether triangles that no ray hits are left out when that saves time."""

    def typical(self) -> Stage:
        """Returns its cost on a typical machine."""
        triangles, looking = self.triangles, 0.0
        if self.culls and culling.is_worthwhile(self.backend, triangles=triangles, rays=self.rays, views=self.views):
            looking = triangles * (PLACE_MS + self.views * LOOK_MS)
            triangles = min(triangles, round(HIT * self.views * self.rays))
        if self.backend == "raytrace":
            once, each = 0.7 + 8.3e-4 * triangles, 0.115 + self.rays * (2.1e-4 + 2.2e-4 * self.textured)
        else:
            once = 1.4 + 1.3e-5 * triangles + 1.4e-5 * self.texels
            each = 0.2 + 1.6e-4 * triangles + self.rays * (3.2e-5 + 1e-5 * self.textured)
        return Stage(looking + once, self.views * each)


def total(stages: Sequence[Stage], written: int, batches: int) -> float:
    """Returns the milliseconds of a job that writes `written` pixels.

    Its first batch goes through all stages. Each further batch takes as long as the slowest stage, or as the work of
    all stages shared among the cores.
    """
    stages = [*stages, Stage(0.0, written * WRITE_MS)]
    spent = [stage.views for stage in stages]
    slowest = max(*spent, sum(stage.views * stage.cores for stage in stages) / count_available_cores())
    return JOB_MS + sum(stage.once for stage in stages) + (sum(spent) + (batches - 1) * slowest) / batches


class Costs:
    """Costs on this machine. Safe to use from several threads."""

    def __init__(self, path: Path | None, *, measure: bool = True) -> None:
        """Reads the kept measurements.

        `path`: the file that keeps measurements, or None to keep them in memory. `measure`: whether to measure what the
        file lacks; otherwise typical costs are used instead.
        """
        self._path, self._lock, self._measured, self._measures = path, threading.RLock(), _read(path), measure
        is_kept = path is not None or cache_folder.is_read_only
        self.not_kept = "" if is_kept else "there is no cache folder; set CIIR_CACHE"
        """Why measurements are not kept in the file; empty if they are."""

    def rendering(self, views: Rendering) -> Stage:
        """Returns the cost of rendering. OpenGL is never started only for a measurement."""
        typical, name = views.typical(), f"{views.backend}; {machine()}"
        starts = views.backend == "raster" and not backends.is_backend_open("raster")
        factor = 1.0 if starts and name not in self._measured else self._get(name, lambda: _factor(views.backend), 1.0)
        return Stage(factor * typical.once + OPENGL_START_MS * starts, factor * typical.views)

    def upscaling(self, model: str, scale: int, *, pixels: int, views: int, batches: int) -> Stage:
        """Returns the cost of `views` views in `batches` batches, with `pixels` pixels of each given to that model."""
        card = catalogue.get_entry(model).card
        name = f"{model} x{scale}, {'interpolation' if card is None else card.sha256[:12]}; {machine()}"
        work = VIEWS * (SIDE**2 + VIEW_PIXELS) + CALL_PIXELS
        macs = 0.0 if card is None else card.macs_per_output_pixel * scale**2
        typical = TYPICAL_INTERPOLATION_MS if card is None else macs * TYPICAL_MAC_MS[card.precision]
        ms = self._get(name, lambda: measure(_upscaler(model, scale)) / work, typical)
        starts = card is not None and "onnxruntime" not in sys.modules
        cores = 1 if card is None else count_available_cores()
        return Stage(NETWORK_START_MS * starts, ms * (views * (pixels + VIEW_PIXELS) + batches * CALL_PIXELS), cores)

    def _get(self, name: str, measured: Callable[[], float], typical: float) -> float:
        with self._lock:
            if name not in self._measured:
                if not self._measures:
                    return typical
                self._measured[name] = measured()
                try:
                    self._write()
                except (OSError, ValueError) as error:  # ValueError: from `replacing`, if the folder is not one
                    self.not_kept = f"{self._path} can't be written ({error})"
            return self._measured[name]

    def _write(self) -> None:
        if self._path is not None and not cache_folder.is_read_only:
            everything = _read(self._path) | self._measured  # another process may have measured something else
            with replacing(self._path) as file:
                file.write(json.dumps(everything, indent=1).encode())


@cache
def costs(*, measure: bool = True) -> Costs:
    """Returns this process's costs, which are kept in the cache folder. `measure` is the same as in `Costs`."""
    folder = cache_folder.folder()
    return Costs(None if folder is None else folder / cache_folder.COSTS, measure=measure)


@cache
def machine() -> str:
    """Describes what measurements are valid for: processor, cores and versions."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("ciir", "numpy", "onnxruntime", "embreex", "pyrender"))
    cores = count_available_cores()
    return f"{processor.processor_name()}, {cores} cores, Python {platform.python_version()}, {packages}"


def _read(path: Path | None) -> dict[str, float]:
    """Reads the measurements in a file, without damaged ones."""
    try:
        content = json.loads(path.read_bytes()) if path is not None else {}
        return {name: ms for name, ms in content.items() if isinstance(ms, float) and 0 < ms < math.inf}
    except (OSError, ValueError, AttributeError, RecursionError):
        return {}


def measure(run: Callable[[], object]) -> float:
    """Measures the milliseconds of `run` without other work: least processor time over the most cores of a round."""
    run()
    spent: list[float] = []
    busy = 1.0
    while len(spent) < ROUNDS or 1000 * sum(spent) < LEAST_MS:
        begun, worked = time.perf_counter(), time.process_time()
        run()
        spent.append(max(time.process_time() - worked, 1e-9))
        busy = max(busy, spent[-1] / max(time.perf_counter() - begun, 1e-9))
    return 1000 * min(spent) / min(busy, count_available_cores())


def _factor(backend: str) -> float:
    """Measures how many times slower a backend is here than on a typical machine."""
    renderer, mesh, views = backends.open_backend(backend)[0], load_scene("vase"), [(0, 0), (1, 1), (2, 2)]
    array = LensArray(SIDE, SIDE, 3, 3, 1.0, 0.05)
    matrix = frame_scene(mesh, array)
    typical = Rendering(backend, mesh.triangles, 16 * SIDE**2, len(views)).typical()
    ms = measure(lambda: list(renderer.render_views(mesh.transform(matrix), array, views, samples=4)))
    return ms / (typical.once + typical.views)


def _upscaler(model: str, scale: int) -> Callable[[], object]:
    """Returns a function that upscales views of noise.

    The views are the same except for one pixel: those of a light field match, and nothing is skipped.
    """
    pictures = np.tile(np.random.default_rng(0).integers(0, 256, (SIDE, SIDE, 3), np.uint8), (49, 1, 1, 1))
    pictures[:, 0, 0, 0] = np.arange(49)
    if model in catalogue.list_single_image_names():
        single = catalogue.load_upscaler(model, scale=scale)
        return lambda: upscale_pixels(single, pictures[:VIEWS])
    network = catalogue.load_light_field_network(model, scale=scale)
    fallback = catalogue.load_upscaler(catalogue.picture_default_name(), scale=scale)
    views = dict(zip(np.ndindex(7, 7), pictures, strict=True))
    wanted = [(2 + number // 3, 2 + number % 3) for number in range(VIEWS)]  # their windows are complete
    return lambda: upscale_views(network, fallback, views, wanted, (7, 7))
