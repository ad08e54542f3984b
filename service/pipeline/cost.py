"""What rendering, upscaling and encoding cost on this machine, milliseconds: measured once and kept, to predict from.

Each kind of work has a linear model of a few coefficients, which a few hundred milliseconds of that work give when a
prediction first needs them (`service.pipeline.measuring`): casting rays, drawing by OpenGL, each network, PNG. The
file is for
one processor, number of cores and set of packages; any other measures again.
"""

from __future__ import annotations

import json
import math
import platform
import sys
import threading
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING

from ciir.models import catalogue, processor
from ciir.models.session import available_cores
from ciir.renderer import backends
from ciir.renderer.backends import culling
from ciir.renderer.writers.atomic_write import replacing
from ciir.service.pipeline import cache_folder as cached
from ciir.service.pipeline import measuring

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from ciir.renderer.scene import Scene

FILE = "costs.json"
FORMAT = 2
"""Of the coefficients; another number where one of the models below takes others."""
OPENGL_START_MS, NETWORK_START_MS = 700.0, 60.0
"""What the first view by OpenGL and the first network cost a process beside the work itself. Typical, not measured:
nobody starts OpenGL to learn that it would have been the wrong way, and what a start takes depends on what the system
has in memory just then. `python -m ciir.benchmarks.planning` holds both against processes of their own."""
OPENGL_TYPICAL = measuring.OpenGL(0.8, 1.5e-4, 1e-5, 0.2, 1.2e-4, 3e-5, 5e-6, 1.0)
"""What `measuring.opengl_cost` gives where OpenGL has not run on this machine yet."""
PLACE_MS, LOOK_MS, MET = 1.2e-4, 3e-5, 2
"""Where what no ray meets is left out: milliseconds for a triangle that is placed, and that is looked at for each view;
and how many are left for each ray. Little beside the work, so that typical numbers do."""
_COUNTS = {"rays": len(measuring.Rays._fields), "opengl": len(measuring.OpenGL._fields), "png": 2}
"""Coefficients of each kind of work; all other names are networks."""
_PACKAGES = ("ciir", "numpy", "onnxruntime", "embreex", "pyrender")


@dataclass(frozen=True)
class Stage:
    """What a stage of the pipeline takes."""

    once: float
    """Milliseconds before its first view: nothing else runs meanwhile."""
    views: float
    """Milliseconds of all views, by itself."""
    cores: float
    """How many it keeps busy."""


def together(stages: Sequence[Stage], turns: int, cores: int) -> float:
    """Milliseconds of stages that overlap in `turns` turns (`service.pipeline.prefetch`) on so many `cores`.

    The first turn goes through all stages; from then on one is finished as often as the slowest stage, or the work of
    all stages shared among the cores, allows.
    """
    spent = [stage.views for stage in stages]
    shared = sum(stage.views * stage.cores for stage in stages) / cores
    once = sum(stage.once for stage in stages)
    return once + (sum(spent) + (turns - 1) * max(*spent, shared)) / turns


class Costs:
    """Coefficients by the name of the work; may be used from several threads."""

    def __init__(self, path: Path | None) -> None:
        """Reads `path`, where that is a file for this machine; None keeps everything in memory."""
        self._path = path
        self._lock = threading.RLock()
        self.trouble = "" if path is not None else "no cache folder is known; set CIIR_CACHE"
        """Why what was measured isn't kept in the file, in words; empty where it is."""
        self._known = _read(path) if path is not None else {}

    def of(self, name: str, measure: Callable[[], tuple[float, ...]]) -> tuple[float, ...]:
        """The coefficients called `name`, measured now where they are not known."""
        with self._lock:
            if name not in self._known:
                self._known[name] = measure()
                self._write()
            return self._known[name]

    def knows(self, name: str) -> bool:
        """Whether these coefficients are known without measuring."""
        return name in self._known

    def rendering(self, backend: str, scene: Scene, *, rays: int, views: int, culls: bool = True) -> Stage:
        """`views` of a new scene, `rays` points sampled for each, by `raytrace` or `raster`.

        `culls`: what no ray meets is left out first, where that pays.
        """
        triangles, looking = scene.triangles, 0.0
        textures = [(part.texture.pixels[..., 0].size, len(part.faces)) for part in scene.parts if part.texture]
        textured = sum(count for _, count in textures) / scene.triangles
        if culls and culling.pays(backend, triangles=triangles, rays=rays, views=views):
            looking = triangles * (PLACE_MS + views * LOOK_MS)
            triangles = min(triangles, MET * views * rays)
        if backend == "raytrace":
            by = measuring.Rays(*self.of("rays", measuring.rays_cost))
            casting = by.view + rays * (by.ray + textured * by.textured)
            return Stage(looking + by.scene + triangles * by.triangle, views * casting, 1.0)
        is_open = backends.is_open("raster")
        is_known = is_open or self.knows("opengl")
        of = measuring.OpenGL(*self.of("opengl", measuring.opengl_cost)) if is_known else OPENGL_TYPICAL
        loading = looking + of.scene + triangles * of.triangle + sum(texels for texels, _ in textures) * of.texel
        drawing = of.view + triangles * of.drawn + rays * (of.sample + textured * of.textured)
        return Stage(loading + (0.0 if is_open else OPENGL_START_MS), views * drawing, of.cores)

    def upscaling(self, model: str, scale: int, *, pixels: int, views: int) -> Stage:
        """`views` of `pixels` by a model of the catalogue, with nothing skipped."""
        entry = next(entry for entry in catalogue.entries() if entry.name == model)
        is_network = entry.card is not None
        start = NETWORK_START_MS if is_network and "onnxruntime" not in sys.modules else 0.0
        name = f"{model} x{scale}" + (f" {entry.card.sha256[:12]}" if entry.card is not None else "")
        of = measuring.Network(
            *self.of(name, lambda: measuring.network_cost(model, scale, is_light_field=entry.is_light_field))
        )
        if views == 1:
            return Stage(start, of.alone + pixels * of.pixel, of.cores)
        return Stage(start, views * (of.of_many + pixels * of.pixel_of_many), of.cores_of_many)

    def encoding(self, *, pixels: int, views: int) -> Stage:
        """`views` of `pixels`, as they are written."""
        each, by_pixel = self.of("png", measuring.encoding_cost)
        return Stage(0.0, views * (each + pixels * by_pixel), 1.0)

    def _write(self) -> None:
        if self._path is None:
            return
        try:
            everything = _read(self._path) | self._known  # another process may have measured something else
            with replacing(self._path) as file:
                file.write(json.dumps({"machine": machine(), "ms": everything}, indent=1).encode())
        except (OSError, ValueError) as error:  # ValueError: the project's own faults, of a place that is no folder
            self.trouble = f"{self._path} can't be written ({error})"


@cache
def machine() -> str:
    """What the coefficients hold for: processor, cores and versions."""
    packages = ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
    return f"{FORMAT}: {processor.name()}, {available_cores()} cores, Python {platform.python_version()}, {packages}"


@cache
def costs() -> Costs:
    """This process's, of the file in the cache folder."""
    folder = cached.folder()
    return Costs(None if folder is None else folder / FILE)


def _read(path: Path) -> dict[str, tuple[float, ...]]:
    """The coefficients in `path`; none where it isn't there, is broken, or is another machine's: all are measured."""
    try:
        held = json.loads(path.read_bytes())
        if held["machine"] != machine():
            return {}
        known = {str(name): tuple(float(value) for value in values) for name, values in held["ms"].items()}
    except (OSError, LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
        return {}
    return {
        name: values
        for name, values in known.items()
        if len(values) == _COUNTS.get(name, len(measuring.Network._fields))
        and all(math.isfinite(v) and v >= 0 for v in values)
    }
