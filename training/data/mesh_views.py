"""Views of meshes as training pairs: views as the service renders them, and clean pictures at a finer pitch.

A mesh is rotated at random, framed as in the service, scaled, and rendered for random pixels of 15x15, with arrays of
24x24, 48x48 and 96x96 lenses. Views of the smaller arrays are joined into one picture, so that crops have equal sizes.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from tqdm import tqdm

from ciir.models.light_field.network import LUMA
from ciir.models.light_field.planes import Range
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.readers import inputs, meshes
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.registry import MeshFormat
from ciir.training.data.downscale import Pair
from ciir.training.data.rendered import SAMPLES, SIDE, render_views
from ciir.training.data.solids import draw_background

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from ciir.renderer.scene import Scene

PICTURES = 24
"""Number of pictures of each mesh, a third of them for each of `LENSES`."""
LENSES = (SIDE // 4, SIDE // 2, SIDE)
"""Number of lenses along each side of the arrays."""
PIXELS = 15
"""Number of pixels along each side under a lens, which is the service's default."""
NEAREST = 2.5
"""Largest scale of an object relative to its framed size."""
FARTHEST = 0.7
MOVED = (0.4, 1.0)
"""Range of pixels by which the farthest side of a light field moves from one view to the next."""
ASIDE = 0.2
"""Largest tangent of the direction of a view."""
TILT = 0.6
"""Largest angle between a mesh's own up direction and the vertical, radians."""


class MeshLightField(NamedTuple):
    """A light field of a mesh with its truth, 8 bit.

    `views` and `colours` have an entry for each kind of array: the luma of all views of a window `(25, h, w)`, and one
    of them in colour `(3, h, w)`. `high` is the truth of that one, `(3, 2*h, 2*w)`, and `own` its row and column.
    `disparities` is the range between the nearest and the farthest side of its content.
    """

    views: dict[str, Tensor]
    colours: dict[str, Tensor]
    high: Tensor
    own: tuple[int, int]
    disparities: Range

    def to(self, device: torch.device) -> MeshLightField:
        """Returns a copy on a device."""
        views, colours = ({kind: of.to(device) for kind, of in each.items()} for each in (self.views, self.colours))
        return self._replace(views=views, colours=colours, high=self.high.to(device))


def read_mesh(path: str | Path) -> Scene:
    """Reads the mesh in the file, folder or zip at `path` with the files that it refers to, and prints its notes.

    Raises `ValueError` if there is no mesh, or it can't be read.
    """
    bundle = Bundle.from_path(Path(path))
    found = inputs.find_main(bundle)
    format_, key = found or (None, "")
    if format_ is None or not isinstance(format_, MeshFormat):
        raise ValueError(f"{path}: holds pictures, not a mesh; name mesh files only")
    scene = meshes.read(bundle, key, format_)
    for note in scene.notes:
        tqdm.write(f"{path}: {note}", file=sys.stderr)
    return scene


def draw_rotation(random: np.random.Generator) -> NDArray[np.float64]:
    """Draws a 4x4 rotation: any angle about the vertical, then a tilt of up to `TILT`."""
    turn, tilt = random.uniform(0, 2 * np.pi), random.uniform(-TILT, TILT)
    about_y = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    matrix = np.eye(4)
    matrix[:3, :3] = about_x @ about_y
    return matrix


def _draw_shear(random: np.random.Generator) -> NDArray[np.float64]:
    """Draws a 4x4 matrix that shears a scene as if it were seen in views from the side."""
    matrix = np.eye(4)
    matrix[:2, 2] = random.uniform(-ASIDE, ASIDE, 2)
    return matrix


def _place_mesh(random: np.random.Generator, mesh: Scene, array: LensArray) -> Scene:
    placed = mesh.transform(draw_rotation(random))
    nearer = np.diag([*[np.exp(random.uniform(np.log(FARTHEST), np.log(NEAREST)))] * 3, 1.0])
    return placed.transform(nearer @ frame_scene(placed, array))


def render_pairs(mesh: Scene, *, seed: int, index: int, scale: int) -> tuple[Pair, Pair]:
    """Renders picture number `index` of a mesh. Returns (LR, truth) for a pinhole array and for a lenslet array.

    LR is `(96, 96, 3)`, with 1, 4 or 16 views side by side. The truth is `scale` times as large.
    """
    random = np.random.default_rng((seed, index, 2))
    side = LENSES[index % len(LENSES)]
    across = SIDE // side
    array = LensArray(side, side, PIXELS, PIXELS)
    placed = _place_mesh(random, mesh, array)
    views = [(int(v), int(u)) for v, u in random.integers(0, PIXELS, (across**2, 2))]
    all_seen = render_views(placed, array, views, background=draw_background(random), scale=scale)
    pinhole, lenslet, truth = (_join_views(np.stack(of)) for of in zip(*all_seen, strict=True))
    return Pair(pinhole, truth), Pair(lenslet, truth)


def render_window(
    mesh: Scene, *, seed: int, index: int, own: tuple[int, int] = (WINDOW_SIDE // 2, WINDOW_SIDE // 2)
) -> MeshLightField:
    """Renders light field number `index` of a mesh: 5x5 views of an array of 48x48 or 96x96 lenses, as close together
    as the service renders them, and the truth of the view at row and column `own`.
    """
    random = np.random.default_rng((seed, index, 3))
    side = LENSES[1 + index % 2]
    placed = _place_mesh(random, mesh, LensArray(side, side, PIXELS, PIXELS)).transform(_draw_shear(random))
    near, far = (max(0.0, -float(bound[2])) for bound in reversed(placed.bounds()))
    moved = random.uniform(*MOVED)  # pixels, of the farthest side, from one view to the next
    array = LensArray(side, side, WINDOW_SIDE, WINDOW_SIDE, delta=moved / far)
    views = [(v, u) for v in range(WINDOW_SIDE) for u in range(WINDOW_SIDE)]
    background = draw_background(random)
    middle = own[0] * WINDOW_SIDE + own[1]
    colours, lumas = {}, {}
    backend = RaytraceBackend()
    for kind, samples in (("pinhole", 1), ("lenslet", SAMPLES)):
        made = backend.render_views(placed, array, views, samples=samples, background=background)
        pictures = np.stack([view[..., :3] for view in made])
        colours[kind] = torch.from_numpy(pictures[middle].copy()).permute(2, 0, 1)
        lumas[kind] = torch.from_numpy(np.rint(pictures @ np.array(LUMA)).astype(np.uint8))
    fine = backend.render_views(placed, array.refine(2), [views[middle]], samples=SAMPLES, background=background)
    high = torch.from_numpy(next(fine)[..., :3].copy()).permute(2, 0, 1)
    return MeshLightField(lumas, colours, high, own, Range(-moved, -moved * near / far))


def _join_views(views: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Joins views `(n*n, h, w, 3)` into a picture `(n*h, n*w, 3)`, row by row."""
    count, height, width, channels = views.shape
    across = round(count**0.5)
    rows = views.reshape(across, across, height, width, channels).swapaxes(1, 2)
    return rows.reshape(across * height, across * width, channels)
