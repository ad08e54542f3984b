"""Rendered light fields whose disparity is known exactly: meshes in front of a textured wall.

The wall stands 0.15 widths of the lens array behind the mesh. It has noise of five octaves on it, so that every pixel
has texture on at least one side of an outline. The truth is the depth channel of the backend.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy import ndimage

from ciir.renderer.backends import open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.scene import Part, Scene, Texture
from ciir.renderer.scenes import SCENES, load_scene
from ciir.renderer.views import center_view, parse_views

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

MESHES = (
    "spot", "fuze", "duck.glb", "milk-truck.glb", "earth.gltf", "koala.obj", "boot.obj", "bust-draco.glb", "skull.obj",
)  # fmt: skip
"""Meshes in a folder, in addition to the scenes that ship."""
SIDE, VIEWS = 512, 9
DELTA = 0.01
"""Tangent between neighbouring views: up to 6 pixels of disparity for views of 512x512 pixels."""
SAMPLES = 3
"""Rays along each side of a pixel."""
TEXTURE = 512
OCTAVES = ((1, 1.0), (2, 1.5), (4, 2.0), (8, 3.0), (16, 4.0))
"""Standard deviation of the blur in texels, and amplitude, of each octave."""
CONTRAST = 45
"""Standard deviation of the wall's texture, in 8-bit levels."""


@dataclass(frozen=True, eq=False)
class ExactScene:
    """A light field with the true disparity of its centre view."""

    name: str
    light_field: LightField
    """RGB, with the depth sense `lenses`."""
    disparity: NDArray[np.float32]
    """The true disparity `(H, W)`, in the sense of `renderer.focus.disparity.DisparityMap`."""


def list_scenes(meshes: Path) -> tuple[list[str], list[str]]:
    """Returns the names of the scenes that can be rendered, and of the meshes that are not in the folder."""
    missing = [name for name in MESHES if not (meshes / name).exists()]
    return [*SCENES, *(name for name in MESHES if name not in missing)], missing


def render_exact(name: str, meshes: Path, *, side: int = SIDE, views: int = VIEWS) -> ExactScene:
    """Renders the scene `name`, one of `list_scenes`, as `views` x `views` views of `side` x `side` pixels."""
    scene = load_scene(name) if name in SCENES else cast("Scene", inputs.read(Bundle.from_path(meshes / name)))
    array = LensArray(side, side, views, views, delta=DELTA)
    mesh = scene.transform(frame_scene(scene, array))
    placed = Scene((*mesh.parts, _make_wall(mesh, array, seed=[*SCENES, *MESHES].index(name))))
    backend, _ = open_backend("auto", triangles=placed.triangles, rays=(SAMPLES * side) ** 2)
    pictures = np.empty((views, views, side, side, 3), np.uint8)
    every = parse_views("all", views, views)
    for view, picture in zip(every, backend.render_views(placed, array, every, samples=SAMPLES), strict=True):
        pictures[view] = picture[..., :3]
    (depth,) = backend.render_depth(placed, array, [center_view(views, views)])
    return ExactScene(name, LightField(pictures), (array.delta / array.pitch * depth).astype(np.float32))


def _make_wall(mesh: Scene, array: LensArray, *, seed: int) -> Part:
    """Makes a square that all views see up to their borders."""
    distance = 0.15 * array.width - mesh.bounds()[0, 2]
    half = array.width / 2 + float(np.abs(array.tangent_x()).max()) * distance
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    vertices = np.column_stack([half * corners, np.full(4, -distance)])
    random = np.random.default_rng(seed)
    noise = np.zeros((TEXTURE, TEXTURE, 3))
    for blur, amplitude in OCTAVES:
        octave = ndimage.gaussian_filter(random.standard_normal(noise.shape), (blur, blur, 0), mode="wrap")
        noise += amplitude * octave / octave.std()
    levels = (128 + CONTRAST * noise / noise.std()).clip(0, 255).astype(np.uint8)
    texture = Texture(np.dstack([levels, np.full(noise.shape[:2], 255, np.uint8)]))
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    return Part(vertices, faces, np.ones((4, 4), np.float32), ((corners + 1) / 2).astype(np.float32), texture)
