"""Cases of meshes: all combinations of backgrounds, pinhole and lenslet arrays, and lens counts, for the centre view.

The truth is what `--strategy direct` makes: the view rendered at the larger size, with each pixel the mean over its own
cell. A mesh is sampled once for each array, and every background is then put behind the same samples, which gives the
pictures of the pipeline to the bit.
"""

from __future__ import annotations

from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.bench.work import PIXELS, SAMPLINGS
from ciir.benchmarks.harm.case import MESH, SCALE, Case
from ciir.models.light_field.windows import list_window
from ciir.renderer.backends import open_backend
from ciir.renderer.backends.culling import cull_if_worthwhile
from ciir.renderer.backends.interface import fill_background
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.placement import Placement
from ciir.renderer.sampling import LENSLET_SAMPLES, average_cells
from ciir.renderer.scenes import SCENES, load_scene
from ciir.renderer.surface import DEFAULT_COLOR, Surface, assemble_scene
from ciir.renderer.views import center_view
from ciir.service.pipeline.options import Options

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View

LENSES = (50, 100, 200)
"""Lenses along each side of an array."""
BACKGROUNDS = {
    "black": (0, 0, 0),
    "white": (255, 255, 255),
    "grey 808080": (128, 128, 128),
    "blue 3060c0": (48, 96, 192),
}
_CHAIR = (  # lowest and highest corner of each box
    ((-0.5, 0.0, -0.5), (0.5, 0.06, 0.5)),  # the seat
    *(((x, -0.8, z), (x + 0.05, 0.0, z + 0.05)) for x in (-0.48, 0.43) for z in (-0.48, 0.43)),  # legs
    *(((-0.45, y, z), (0.45, y + 0.03, z + 0.03)) for y in (-0.6, -0.4) for z in (-0.47, 0.44)),  # rungs
    *(((x, 0.06, -0.48), (x + 0.04, 0.9, -0.44)) for x in np.linspace(-0.48, 0.44, 6)),  # the back's bars
    ((-0.48, 0.9, -0.5), (0.48, 1.0, -0.42)),
)


def make_grey_vase() -> Scene:
    """Makes the shipped vase in the colour of meshes without one."""
    parts = load_scene("vase").parts
    surfaces = [Surface(part.vertices, part.faces.astype(np.int64), color=DEFAULT_COLOR) for part in parts]
    return assemble_scene(surfaces, name="grey vase")


def make_chair() -> Scene:
    """Makes a chair of thin boxes in the colour of meshes without one, turned so that front legs hide parts of rear
    ones.
    """
    sides = np.array([(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6),
                      (0, 6, 4), (1, 5, 7), (1, 7, 3)])  # fmt: skip
    corners = [np.array(list(product(*zip(low, high, strict=True)))) for low, high in _CHAIR]
    faces = np.concatenate([sides + 8 * number for number in range(len(corners))])
    vertices = np.concatenate(corners) @ Placement(rotate=(25, 12, 0)).rotation().T
    return assemble_scene([Surface(vertices, faces, color=DEFAULT_COLOR)], name="grey chair")


OWN: dict[str, Callable[[], Scene]] = {name: partial(load_scene, name) for name in SCENES} | {
    "grey chair": make_chair,
    "grey vase": make_grey_vase,
}
"""The meshes that ship: name -> the function that makes it. The grey ones are untextured."""


def count_cases(lenses: Sequence[int], backgrounds: Sequence[str]) -> int:
    """Returns how many cases `list_cases` makes."""
    return len(lenses) * len(SAMPLINGS) * len(backgrounds)


def list_cases(name: str, mesh: Scene, lenses: Sequence[int], backgrounds: Sequence[str]) -> Iterator[Case]:
    """Yields the cases of a mesh: `lenses` x pinhole, lenslet x `backgrounds`, which are keys of `BACKGROUNDS`."""
    wanted = center_view(*PIXELS)
    window = [view for view, _ in list_window(wanted, PIXELS)]
    low = window[0]
    side = (window[-1][0] - low[0] + 1, window[-1][1] - low[1] + 1)
    for count in lenses:
        array = LensArray(count, count, *PIXELS)
        placed = mesh.transform(frame_scene(mesh, array))
        (fine,) = _sample_views(placed, array.refine(SCALE), [wanted], LENSLET_SAMPLES)
        for sampling in SAMPLINGS:
            samples = LENSLET_SAMPLES if sampling == "lenslet" else 1
            sampled = _sample_views(placed, array, window, samples)
            for background in backgrounds:
                colour = BACKGROUNDS[background]
                views = np.stack([_average(view, colour, samples) for view in sampled])
                yield Case(
                    input=name,
                    kind=MESH,
                    factors={"background": background, "sampling": sampling, "lenses": f"{count}x{count}"},
                    views=views.reshape(*side, *views.shape[1:]),
                    at=(wanted[0] - low[0], wanted[1] - low[1]),
                    truth=_average(fine, colour, LENSLET_SAMPLES),
                    border=0,
                    source=mesh,
                    options=Options(lenses=(count, count), pixels=PIXELS, sampling=sampling, background=colour),
                )


def _sample_views(placed: Scene, array: LensArray, views: Sequence[View], samples: int) -> list[NDArray[np.uint8]]:
    """Returns point samples of each of `views`, `(samples*rows, samples*cols, 4)`, from the backend that the pipeline
    uses.
    """
    backend, _ = open_backend("auto", triangles=placed.triangles, rays=array.rows * array.cols * samples**2)
    scene = cull_if_worthwhile(placed, array, views, backend.name, samples=samples)
    return list(backend.sample_views(scene, array.refine(samples), views))


def _average(sampled: NDArray[np.uint8], background: tuple[int, int, int], samples: int) -> NDArray[np.uint8]:
    """Returns the view `(rows, cols, 3)` in front of `background`."""
    return np.ascontiguousarray(average_cells(fill_background(sampled, background), samples)[..., :3])
