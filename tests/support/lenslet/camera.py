"""Raw lenslet pictures of a mesh, computed ray by ray, and the views that their lenses should give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.backends.embree import PreparedScene, _weigh_corners
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import TANGENT_RANGE, LensArray
from ciir.renderer.scenes import load_scene

if TYPE_CHECKING:
    from ciir.renderer.readers.lenslet.grid import LensGrid


@dataclass(frozen=True)
class Camera:
    """A lens array in front of a scene whose unit of length is the pitch, and a sensor behind the array."""

    scene: PreparedScene
    grid: LensGrid
    size: tuple[int, int]
    """Height and width of the sensor, in pixels."""
    background: tuple[int, int, int] = (0, 0, 0)

    def cast(self, points, offsets):
        """Returns RGB `(n, 3)`, 0 to 255, of rays through the array at `points`, (y, x) in pixels `(n, 2)`. These are
        the rays of the pixels at `offsets` from the lens's centre along the grid's axes."""
        y, x = ((points - (np.array(self.size) - 1) / 2) @ self.grid.axes.T / self.grid.pitch).T
        delta = TANGENT_RANGE / self.grid.pitch
        origins = np.stack([x, -y, np.zeros(len(x))], axis=1)
        directions = np.stack([delta * offsets[:, 1], -delta * offsets[:, 0], -np.ones(len(x))], axis=1)
        placed, along = self.scene._to_embree(origins), directions.astype(np.float32)
        triangle, u, v, _, is_back = self.scene._find_hits(placed, along)
        rgb = np.broadcast_to(np.float32(self.background), (len(x), 3)).copy()
        hit = np.flatnonzero(triangle >= 0)
        rgb[hit] = 255 * self.scene._shade(triangle[hit], _weigh_corners(u[hit], v[hit]), is_back[hit])[0][:, :3]
        return rgb


def make_camera(name, grid, size, background=(0, 0, 0)):
    """Makes a camera in front of the shipped scene `name`, which fills its picture."""
    rows, cols = (int(side / grid.pitch) for side in size)
    array = LensArray(rows, cols, 15, 15, 1.0, TANGENT_RANGE / 15)
    scene = load_scene(name)
    return Camera(PreparedScene(scene.transform(frame_scene(scene, array))), grid, size, background)


EDGE = 0.3
"""Brightness of a lens half a pitch from its centre, relative to 1 at the centre."""


def dim(grid, offsets, edge=EDGE):
    """Computes the brightness of lenses at `offsets` from their centre, (y, x) in pixels `(..., 2)`."""
    squared = (offsets**2).sum(axis=-1) / (grid.pitch / 2) ** 2
    return np.maximum(1 - (1 - edge) * squared, edge / 4)


def take_picture(camera, *, edge=EDGE, noise=2.0, optical=False, white=False):
    """Takes the raw picture `(H, W, 3)` uint8, with one ray for each pixel.

    `edge`: see `EDGE`. `optical`: whether each elemental image is turned by 180 degrees. `white`: whether it shows a
    white wall.
    """
    points = np.stack(np.indices(camera.size), axis=-1).reshape(-1, 2)
    centers = camera.grid.find_centers(*camera.grid.find_nearest(points))
    offsets = (points - centers) @ camera.grid.axes.T
    rgb = np.full((1, 3), 230.0) if white else camera.cast(centers, -offsets if optical else offsets)
    light = (rgb * dim(camera.grid, offsets, edge)[:, None]).reshape(*camera.size, 3)
    picture = light + np.random.default_rng(0).normal(0, noise, light.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)
