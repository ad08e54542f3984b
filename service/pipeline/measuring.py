"""What each kind of work takes on this machine: the coefficients of the models of `service.pipeline.cost`, measured."""

from __future__ import annotations

import time
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.models.session import available_cores
from ciir.renderer import backends

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

ROUNDS, ENOUGH_MS = 5, 150.0
"""Jobs take turns so many times at least, and so long; of each the quickest counts, as all else is others' work."""
TEXELS = 512
"""Along a side of the texture that OpenGL is measured with."""
_SIDES, _OF_MANY = (32, 96), (24, 64)
"""Pixels along a side of the views that networks are measured on: one alone, and many."""
_PICTURE = 200
"""Pixels along a side of the view that is encoded."""


class Rays(NamedTuple):
    """Of casting rays by Embree, in one thread: milliseconds for a new scene and each of its triangles, for each view,
    each ray, and what one costs more where surfaces have textures.
    """

    scene: float
    triangle: float
    view: float
    ray: float
    textured: float


class OpenGL(NamedTuple):
    """Of drawing: milliseconds for a new scene, each of its triangles and of its texels, for each view, each triangle
    in it, each point sampled, and what one costs more where surfaces have textures; cores that Mesa keeps busy.
    """

    scene: float
    triangle: float
    texel: float
    view: float
    drawn: float
    sample: float
    textured: float
    cores: float


class Network(NamedTuple):
    """Of a model: milliseconds for a view alone and each of its pixels, and the cores that it keeps busy; then the same
    for each of many views.
    """

    alone: float
    pixel: float
    cores: float
    of_many: float
    pixel_of_many: float
    cores_of_many: float


class Taken(NamedTuple):
    """What a job took."""

    ms: float
    cores: float
    """That it kept busy."""


def rays_cost() -> Rays:
    """Of balls that fill half of a view."""
    tiny, small, large, textured = _ball(4), _ball(40), _ball(100), _ball(40, TEXELS)
    backend = backends.open_backend("raytrace")[0]
    bare, more, heavy, one, three, one_textured, three_textured = (
        taken.ms
        for taken in least(
            lambda: _views(backend, tiny, 12, 1),
            lambda: _views(backend, tiny, 12, 9),
            lambda: _views(backend, large, 12, 1),
            lambda: _views(backend, small, 96, 1),
            lambda: _views(backend, small, 96, 3),
            lambda: _views(backend, textured, 96, 1),
            lambda: _views(backend, textured, 96, 3),
            is_alone=True,
        )
    )
    by_view, each = slope(bare, more, 1, 9), slope(one, three, 1, 3)
    return Rays(
        scene=max(bare - by_view, 0.0),
        triangle=max(heavy - bare, 0.0) / large.triangles,
        view=by_view,
        ray=each / 96**2,
        textured=max(slope(one_textured, three_textured, 1, 3) - each, 0.0) / 96**2,
    )


def opengl_cost() -> OpenGL:
    """Of balls that fill half of a view, as fine as views are: a triangle costs more where it shows."""
    tiny, large, textured = _ball(4), _ball(100), _ball(100, TEXELS)
    backend = backends.open_backend("raster")[0]
    found = least(
        lambda: _views(backend, tiny, 12, 1),
        lambda: _views(backend, tiny, 12, 9),
        lambda: _views(backend, large, 48, 1, samples=4),
        lambda: _views(backend, large, 48, 3, samples=4),
        lambda: _views(backend, large, 96, 1, samples=4),
        lambda: _views(backend, large, 96, 3, samples=4),
        lambda: _views(backend, textured, 48, 1, samples=4),
        lambda: _views(backend, textured, 48, 3, samples=4),
    )
    bare, more, one, three, fine, finer, one_textured, three_textured = (taken.ms for taken in found)
    by_view, each = slope(bare, more, 1, 9), slope(one, three, 1, 3)
    by_sample = slope(each, slope(fine, finer, 1, 3), 192**2, 384**2)
    each_textured = slope(one_textured, three_textured, 1, 3)
    loading = max(one - each, 0.0)
    return OpenGL(
        scene=max(bare - by_view, 0.0),
        triangle=max(loading - max(bare - by_view, 0.0), 0.0) / large.triangles,
        texel=max(one_textured - each_textured - loading, 0.0) / TEXELS**2,
        view=by_view,
        drawn=max(each - by_view - 192**2 * by_sample, 0.0) / large.triangles,
        sample=by_sample,
        textured=max(each_textured - each, 0.0) / 192**2,
        cores=found[5].cores,
    )


def network_cost(model: str, scale: int, *, is_light_field: bool) -> Network:
    """Of views of noise, all of them the same: those of a light field match, and nothing is skipped."""
    from ciir.renderer.views import parse_views
    from ciir.service.pipeline.plan import Plan
    from ciir.service.pipeline.upscaling import opened

    grid = (7, 7)  # the middle 3x3 have whole windows
    run = opened(Plan("upscale", model, scale, 1, (), is_light_field), grid, skipping=False)
    inner: list[View] = [(v, u) for v in (2, 3, 4) for u in (2, 3, 4)]
    some = inner[: 2 * available_cores()]

    def job(side: int, wanted: list[View]) -> Callable[[], object]:
        noise = np.random.default_rng(0).integers(0, 256, (side, side, 3), np.uint8)
        views = dict.fromkeys(parse_views("all", *grid), noise)
        return lambda: run(views, wanted)

    found = least(*(job(side, [(3, 3)]) for side in _SIDES), *(job(side, some) for side in _OF_MANY))
    small, large, small_of_many, large_of_many = (taken.ms for taken in found)
    alone = _line(small, large, _SIDES)
    of_many = _line(small_of_many / len(some), large_of_many / len(some), _OF_MANY)
    return Network(*alone, found[1].cores, *of_many, found[3].cores)


def encoding_cost() -> tuple[float, float]:
    """Milliseconds for each view that is written, and for each of its pixels, as PNG: of the ball, 8 bit, RGB."""
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.readers.pictures import encode_png

    array = LensArray(_PICTURE, _PICTURE, 3, 3, 1.0 / _PICTURE, 0.05)
    backend = backends.open_backend("raytrace")[0]
    pixels = next(iter(backend.views(_ball(40), array, [(1, 1)])))[..., :3]
    small, large = least(lambda: encode_png(pixels[:20, :20]), lambda: encode_png(pixels), is_alone=True)
    return _line(small.ms, large.ms, (20, _PICTURE))


def slope(small: float, large: float, few: int, many: int) -> float:
    """What one more costs, of two times; at least half of what each costs on average, so that noise makes no gift."""
    return max((large - small) / (many - few), large / many / 2)


def _line(small: float, large: float, sides: tuple[int, int]) -> tuple[float, float]:
    """Milliseconds for each view and each pixel, of what views of two sizes take."""
    few, many = (side**2 for side in sides)
    by_pixel = slope(small, large, few, many)
    return max(large - many * by_pixel, 0.0), by_pixel


def least(*jobs: Callable[[], object], is_alone: bool = False) -> list[Taken]:
    """What each takes of `ROUNDS` or more, after one that warms up, where nobody else has the cores.

    `is_alone`: jobs work in this thread alone, and its own time counts. Else other processes are told from a job by the
    time of all threads here: the least of that, shared among the cores that were busy with it in the round in which
    those were most. Other requests of this process can't be told from it: what is measured beside them may come out
    wrong by as many times as there are cores.
    """
    taken: list[list[Taken]] = [[] for _ in jobs]
    for job in jobs:
        job()
    while len(taken[0]) < ROUNDS or sum(one.ms for some in taken for one in some) < ENOUGH_MS:
        for times, job in zip(taken, jobs, strict=True):
            clock = time.thread_time if is_alone else time.process_time
            begun, worked = time.perf_counter(), clock()
            job()
            spent = max(clock() - worked, 1e-9)
            busy = spent / max(time.perf_counter() - begun, 1e-9)
            times.append(Taken(1000 * spent, busy))
    found = []
    for times in taken:
        most = 1.0 if is_alone else min(max(1.0, *(one.cores for one in times)), available_cores())
        found.append(Taken(min(one.ms for one in times) / most, most))
    return found


@cache
def _ball(segments: int, texels: int = 0) -> Scene:
    """A ball of about `2 * segments**2` triangles in front of an array of width 1, which it fills for the most part.

    With `texels` it has a texture of as many a side.
    """
    from ciir.renderer.scene import Texture
    from ciir.renderer.scenes.modelling import revolve
    from ciir.renderer.surface import Surface, assemble

    turn = np.linspace(-np.pi / 2, np.pi / 2, segments + 1)
    vertices, faces, uv = revolve(np.stack([0.4 * np.cos(turn), 0.4 * np.sin(turn)], 1), segments)
    texture = Texture(np.full((texels, texels, 4), 200, np.uint8)) if texels else None
    surface = Surface(vertices - np.array([0.0, 0.0, 1.0]), faces, uv=uv if texels else None, texture=texture)
    return assemble([surface], name="ball")


def _views(backend: backends.Backend, scene: Scene, lenses: int, count: int, *, samples: int = 1) -> None:
    """The first views of a scene that the backend hasn't seen, framed as every mesh is."""
    from ciir.renderer.framing import frame
    from ciir.renderer.lens_array import LensArray

    array = LensArray(lenses, lenses, 3, 3, 1.0 / lenses, 0.05)
    views: list[View] = [divmod(number, 3) for number in range(count)]
    again = scene.transformed(frame(scene, array))
    for _ in islice(backend.views(again, array, views, samples=samples), count):
        pass
