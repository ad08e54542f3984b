"""What rendering and upscaling cost on this machine, in milliseconds: measured once and kept, to predict from.

Each kind of work has a linear model of a few coefficients, which a few hundred milliseconds of that work give when a
prediction first needs them: casting rays, drawing by OpenGL, each network. The file is for one processor, number of
cores and set of packages; any other measures again.
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
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from models import catalogue, processor
from models.session import available_cores
from renderer import backends
from service import cache as cached
from service.atomic import replacing

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from renderer.scene import Scene
    from renderer.views import View

FILE = "costs.json"
FORMAT = 1
"""Of the coefficients; another number where one of the models below takes others."""
ROUNDS, ENOUGH_MS = 5, 150.0
"""Jobs take turns so many times at least, and so long; of each the quickest counts, as all else is others' work."""
NETWORK_CORES, OPENGL_CORES = 0.8, 1.2
"""Share of its cores that a network keeps busy; cores that Mesa's software renderer does, on average over a job."""
OPENGL_START_MS, NETWORK_START_MS = 700.0, 60.0
"""What the first view by OpenGL and the first network cost a process beside the work itself. Typical, not measured:
nobody starts OpenGL to learn that it would have been the wrong way."""
OPENGL_TYPICAL = (1.5e-4, 1e-5, 6e-5, 2.5e-5)
"""What `opengl` gives where OpenGL has not run on this machine yet."""
_FEW = 2
"""Coefficients of all other work."""
_PACKAGES = ("ciir", "numpy", "onnxruntime", "embreex", "pyrender")
TEXELS = 512
"""Along a side of the texture that OpenGL is measured with."""
_SIDES = (32, 96)
"""Pixels along a side of the views that networks are measured on."""


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

    def rendering(self, backend: str, scene: Scene, *, rays: int, views: int) -> float:
        """`views` of a new scene, `rays` points sampled for each, by `raytrace` or `raster`."""
        triangles = scene.triangles
        if backend == "raytrace":
            by_triangle, by_ray = self.of("rays", rays_cost)
            return triangles * by_triangle + views * rays * by_ray
        is_open = backends.is_open("raster")
        known = self.of("opengl", opengl_cost) if is_open or self.knows("opengl") else OPENGL_TYPICAL
        by_triangle, by_texel, by_drawn, by_sample = known
        texels = sum(part.texture.pixels[..., 0].size for part in scene.parts if part.texture is not None)
        start = 0.0 if is_open else OPENGL_START_MS
        loading = triangles * by_triangle + texels * by_texel
        return start + loading + views * (triangles * by_drawn + rays * by_sample)

    def upscaling(self, model: str, scale: int, *, pixels: int, views: int) -> float:
        """`views` of `pixels` by a model of the catalogue, with nothing skipped."""
        entry = next(entry for entry in catalogue.entries() if entry.name == model)
        is_network = entry.card is not None
        start = NETWORK_START_MS if is_network and "onnxruntime" not in sys.modules else 0.0
        name = f"{model} x{scale}" + (f" {entry.card.sha256[:12]}" if entry.card is not None else "")
        each, by_pixel = self.of(name, lambda: network_cost(model, scale, is_light_field=entry.is_light_field))
        return start + views * (each + pixels * by_pixel)

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


def rays_cost() -> tuple[float, float]:
    """Milliseconds for each triangle of a new scene, and for each ray, by Embree."""
    small, large = _ball(40), _ball(100)
    backend = backends.open_backend("raytrace")[0]
    few, many, rays = least(
        lambda: _views(backend, small, 12, 1),
        lambda: _views(backend, large, 12, 1),
        lambda: _views(backend, small, 96, 3),
    )
    return slope(few, many, small.triangles, large.triangles), slope(few, rays, 12**2, 3 * 96**2)


def opengl_cost() -> tuple[float, float, float, float]:
    """Milliseconds for each triangle and each texel of a new scene, for each triangle in a view, and for each point
    sampled, by OpenGL.
    """
    small, large = _ball(40), _ball(100)
    backend = backends.open_backend("raster")[0]
    one, three, coarse, textured, fine = least(
        lambda: _views(backend, large, 48, 1),
        lambda: _views(backend, large, 48, 3),
        lambda: _views(backend, small, 48, 1),
        lambda: _views(backend, _ball(40, TEXELS), 48, 1),
        lambda: _views(backend, small, 96, 1, samples=4),
        cores=min(OPENGL_CORES, available_cores()),
    )
    by_drawn = slope(one, three, large.triangles, 3 * large.triangles)
    by_triangle = max(one / large.triangles - by_drawn, 0.0)
    by_texel = max(textured - coarse, 0.0) / TEXELS**2
    return by_triangle, by_texel, by_drawn, slope(coarse, fine, 48**2, (4 * 96) ** 2)


def network_cost(model: str, scale: int, *, is_light_field: bool) -> tuple[float, float]:
    """Milliseconds for each view and each of its pixels, by a model; of a light-field network in a grid of 3x3."""
    from models.skip import NOTHING
    from renderer.views import parse_views
    from service.enlarging import opened
    from service.plan import Plan

    grid = (3, 3) if is_light_field else (1, 1)
    run = opened(Plan("upscale", model, scale, 1, (), is_light_field), grid, NOTHING)
    every, middle = parse_views("all", *grid), parse_views("center", *grid)

    def job(side: int) -> Callable[[], object]:
        noise = np.random.default_rng(0).integers(0, 256, (len(every), side, side, 3), np.uint8)
        views = dict(zip(every, noise, strict=True))
        return lambda: run(views, middle)

    small, large = least(*map(job, _SIDES), cores=max(1.0, NETWORK_CORES * available_cores()))
    few, many = (side**2 for side in _SIDES)
    by_pixel = slope(small, large, few, many)
    return max(large - many * by_pixel, 0.0), by_pixel


def slope(small: float, large: float, few: int, many: int) -> float:
    """What one more costs, of two times; at least half of what each costs on average, so that noise makes no gift."""
    return max((large - small) / (many - few), large / many / 2)


def least(*jobs: Callable[[], object], cores: float = 1.0) -> list[float]:
    """Milliseconds of the quickest of `ROUNDS` or more of each, after one that warms up.

    `cores`: how many a job keeps busy. Where the clock on the wall went further than the time on all of them, others
    had them meanwhile: then the latter counts.
    """
    taken: list[list[float]] = [[] for _ in jobs]
    for job in jobs:
        job()
    while len(taken[0]) < ROUNDS or sum(map(sum, taken)) < ENOUGH_MS:
        for times, job in zip(taken, jobs, strict=True):
            begun, worked = time.perf_counter(), time.process_time()
            job()
            times.append(1000 * min(time.perf_counter() - begun, (time.process_time() - worked) / cores))
    return [min(times) for times in taken]


@cache
def _ball(segments: int, texels: int = 0) -> Scene:
    """A ball of about `2 * segments**2` triangles in front of an array of width 1, which it fills for the most part.

    With `texels` it has a texture of as many a side.
    """
    from renderer.modelling import revolve
    from renderer.scene import Texture
    from renderer.surface import Surface, assemble

    turn = np.linspace(-np.pi / 2, np.pi / 2, segments + 1)
    vertices, faces, uv = revolve(np.stack([0.4 * np.cos(turn), 0.4 * np.sin(turn)], 1), segments)
    texture = Texture(np.full((texels, texels, 4), 200, np.uint8)) if texels else None
    surface = Surface(vertices - np.array([0.0, 0.0, 1.0]), faces, uv=uv if texels else None, texture=texture)
    return assemble([surface], name="ball")


def _views(backend: backends.Backend, scene: Scene, lenses: int, count: int, *, samples: int = 1) -> None:
    """The first views of a scene that the backend hasn't seen."""
    from renderer.lens_array import LensArray

    array = LensArray(lenses, lenses, 3, 3, 1.0 / lenses, 0.05)
    views: list[View] = [divmod(number, 3) for number in range(count)]
    again = scene.transformed(np.eye(4))
    for _ in islice(backend.views(again, array, views, samples=samples), count):
        pass


def _read(path: Path) -> dict[str, tuple[float, ...]]:
    """The coefficients in `path`; none where it isn't there, is broken, or is another machine's: all are measured."""
    try:
        held = json.loads(path.read_bytes())
        if held["machine"] != machine():
            return {}
        known = {str(name): tuple(float(value) for value in values) for name, values in held["ms"].items()}
    except (OSError, LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
        return {}
    counts = {"opengl": len(OPENGL_TYPICAL)}
    return {
        name: values
        for name, values in known.items()
        if len(values) == counts.get(name, _FEW) and all(math.isfinite(v) and v >= 0 for v in values)
    }
