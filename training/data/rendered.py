"""Rendered views of random scenes as training pairs: views of a lens array and clean pictures at a finer pitch.

Tilted and overlapping polygons, or solids (`solids`), textured or plain, are ray traced. LR is one ray for each lens
(pinhole) or the mean over the lens (lenslet). The truth of both is the area average over cells of `pitch / scale`.
"""

from __future__ import annotations

import signal
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import TYPE_CHECKING

import numpy as np

from ciir import cores
from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Part, Scene
from ciir.training.data.downscale import Pair
from ciir.training.data.solids import draw_background, draw_texture, make_solids

if TYPE_CHECKING:
    from collections.abc import Iterator

    from _typeshed import SupportsLenAndGetItem
    from numpy.typing import NDArray

    from ciir.renderer.views import View
    from ciir.training.data.pictures import Picture

SIDE = 96
"""Number of lenses along each side of the array, which is also the LR picture's side."""
SAMPLES = 4
SOLID = 0.6
"""Share of scenes of solids; the others are of polygons."""
SCENES_PER_PROCESS = 8
"""Number of scenes for which a process is started. They take a few times as long as its start."""
PLAIN = 0.35
"""Share of polygons without a texture."""


def make_polygon(random: np.random.Generator, pictures: SupportsLenAndGetItem[Picture]) -> Part:
    """Makes a flat polygon of 3 to 24 corners in front of the array, thin or round, rotated and tilted at random."""
    corners = int(random.choice([3, 4, 4, 5, 7, 24]))
    angle = np.sort(random.uniform(0, 2 * np.pi, corners)) if corners < 24 else np.linspace(0, 2 * np.pi, 25)[:-1]
    size = SIDE * np.exp(random.uniform(np.log(0.05), np.log(0.9)))
    thin = np.exp(random.uniform(np.log(0.05), 0))
    flat = size * np.stack([np.cos(angle), thin * np.sin(angle)], axis=1)  # (n, 2)
    turn, tilt, pitch = random.uniform(0, 2 * np.pi), random.uniform(-1.2, 1.2), random.uniform(-1.2, 1.2)
    across = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
    down = np.array([-np.sin(turn) * np.cos(pitch), np.cos(turn) * np.cos(pitch), np.sin(pitch)])
    middle = np.array([*random.uniform(-SIDE / 2, SIDE / 2, 2), -random.uniform(2, 4) * SIDE])
    vertices = middle + flat[:, :1] * across + flat[:, 1:] * down
    faces = np.array([[0, i, i + 1] for i in range(1, corners - 1)], np.int32)
    colors = np.ones((corners, 4), np.float32)
    if random.random() < PLAIN:
        colors[:, :3] = random.uniform(0, 1, 3) * random.uniform(0.7, 1, (corners, 1))
        return Part(vertices, faces, colors)
    colors[:, :3] = random.uniform(0.5, 1, (corners, 1))
    return Part(vertices, faces, colors, *draw_texture(random, pictures, flat))


def draw_parts(random: np.random.Generator, pictures: SupportsLenAndGetItem[Picture]) -> list[Part]:
    """Draws the parts of a scene: many polygons, or a few solids."""
    if random.random() < SOLID:
        return make_solids(random, pictures, extent=SIDE, count=int(random.integers(1, 7)))
    return [make_polygon(random, pictures) for _ in range(random.integers(8, 28))]


def render_pairs(
    pictures: SupportsLenAndGetItem[Picture], *, seed: int, index: int, scale: int = 2
) -> tuple[Pair, Pair]:
    """Renders scene number `index`. Returns (LR, truth) for a pinhole array and for a lenslet array.

    `pictures`: textures to choose from, 8-bit RGB `(H, W, 3)`. LR is `(96, 96, 3)`, the truth `scale` times as large.
    """
    random = np.random.default_rng((seed, index))
    scene = Scene(tuple(draw_parts(random, pictures)))
    array = LensArray(SIDE, SIDE, 1, 1)
    background = draw_background(random)
    ((pinhole, lenslet, truth),) = render_views(scene, array, [(0, 0)], background=background, scale=scale)
    return Pair(pinhole, truth), Pair(lenslet, truth)


def render_scenes(
    pictures: SupportsLenAndGetItem[Picture], count: int, *, seed: int, scale: int = 2
) -> Iterator[tuple[Pair, Pair]]:
    """Renders scenes 0 to `count` like `render_pairs`, in order, in as many processes as there are cores.

    `pictures` is sent to each of them; `training.data.pictures.Pictures` is sent without its decoded pictures.
    """
    render = partial(_render_scene, pictures, seed, scale)
    processes = min(cores.count_available_cores(), count // SCENES_PER_PROCESS)
    if processes < 2:
        yield from map(render, range(count))
        return
    # Not forked, because this process may have threads and use a GPU.
    with ProcessPoolExecutor(processes, get_context("spawn"), initializer=start_process) as pool:
        yield from pool.map(render, range(count), chunksize=2)


def start_process() -> None:
    """Makes this process ignore Ctrl-C, which its parent handles, and leave the other cores to other processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cores.most_cores = 1


def _render_scene(pictures: SupportsLenAndGetItem[Picture], seed: int, scale: int, index: int) -> tuple[Pair, Pair]:
    return render_pairs(pictures, seed=seed, index=index, scale=scale)


def render_views(
    scene: Scene, array: LensArray, views: list[View], *, background: tuple[int, int, int], scale: int
) -> list[tuple[Picture, Picture, Picture]]:
    """Renders each of `views` of a scene in front of `array`: with pinholes and with lenslets, `(rows, cols, 3)`, and
    their truth.

    The truth, `(scale*rows, scale*cols, 3)`, is the view of lenslets of `pitch / scale`.
    """
    backend = RaytraceBackend()
    by = ((array, 1), (array, SAMPLES), (array.refine(scale), SAMPLES))
    pictures = [backend.render_views(scene, lenses, views, samples=n, background=background) for lenses, n in by]
    return list(zip(*(map(_drop_alpha, of) for of in pictures), strict=True))


def _drop_alpha(view: NDArray[np.uint8]) -> Picture:
    """Removes A, the coverage, from RGBA."""
    return np.ascontiguousarray(view[..., :3])
