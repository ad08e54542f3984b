"""Random solids for training scenes: smooth or angular, plain or textured, some thin.

They are lit in the same way as the renderer lights meshes. They add untextured objects and thin parts that hide others,
which photographs and layers of flat polygons lack.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
import trimesh

from ciir.renderer.scene import Part, Texture
from ciir.renderer.shading import compute_normals, shade

if TYPE_CHECKING:
    from collections.abc import Callable

    from _typeshed import SupportsLenAndGetItem
    from numpy.typing import NDArray

    from ciir.training.data.pictures import Picture

SHAPES: tuple[Callable[[], trimesh.Trimesh], ...] = (
    lambda: trimesh.creation.icosphere(subdivisions=3, radius=0.5),
    lambda: trimesh.creation.capsule(height=0.6, radius=0.2, count=[24, 24]),
    lambda: trimesh.creation.cylinder(radius=0.5, height=1.0, sections=32),
    lambda: trimesh.creation.torus(major_radius=0.35, minor_radius=0.12, major_sections=40, minor_sections=16),
    lambda: trimesh.creation.cone(radius=0.5, height=1.0, sections=32),
    lambda: trimesh.creation.box(extents=(1.0, 1.0, 1.0)),
)
"""Functions that make shapes about as large as a cube of side 1."""
BARS = 0.25
"""Share of solids that are several thin parallel bars, like the legs of a chair."""
PLAIN = 0.6
"""Share of solids without a texture. Half of those are grey."""
BUMPY = 0.4
"""Share of solids whose surface is bent by waves."""
TEXELS = (0.4, 4.0)
"""Range of texels for each lens pitch: from blurred to finer than a pinhole array can sample."""


def make_solids(
    random: np.random.Generator, pictures: SupportsLenAndGetItem[Picture], *, extent: float, count: int
) -> list[Part]:
    """Makes `count` solids in front of an array with `extent` lenses along each side and pitch 1."""
    made = []
    for _ in range(count):
        size = extent * np.exp(random.uniform(np.log(0.2), np.log(1.1)))
        middle = np.array([*random.uniform(-extent * 0.35, extent * 0.35, 2), -random.uniform(2, 4) * extent])
        shape = _make_bars(random) if random.random() < BARS else _make_shape(random)
        turned = (shape.vertices * size) @ _draw_turn(random).T + middle
        made.append(_paint(random, pictures, np.asarray(turned), np.asarray(shape.faces, np.int64)))
    return made


def _make_shape(random: np.random.Generator) -> trimesh.Trimesh:
    shape = SHAPES[int(random.integers(len(SHAPES)))]()
    vertices = np.asarray(shape.vertices).copy()
    if random.random() < BUMPY:
        waves, phase = random.uniform(-9, 9, (3, 3)), random.uniform(0, 2 * np.pi, 3)
        vertices += 0.06 * np.sin(vertices @ waves + phase)
    stretch = np.exp(random.uniform(np.log(0.25), 0, 3))
    return trimesh.Trimesh(vertices * stretch, shape.faces, process=False)


def _make_bars(random: np.random.Generator) -> trimesh.Trimesh:
    count, thin = int(random.integers(2, 7)), float(np.exp(random.uniform(np.log(0.01), np.log(0.08))))
    bars = []
    for place in np.linspace(-0.5, 0.5, count):
        bar = trimesh.creation.cylinder(radius=thin, height=1.0, sections=12)
        bar.apply_translation([place, random.uniform(-0.3, 0.3), 0])
        bars.append(bar)
    joined = cast("trimesh.Trimesh", trimesh.util.concatenate(bars))
    return trimesh.Trimesh(joined.vertices, joined.faces, process=False)


def _draw_turn(random: np.random.Generator) -> NDArray[np.float64]:
    """Draws a uniformly distributed rotation, `(3, 3)`."""
    quaternion = random.standard_normal(4)
    return np.asarray(trimesh.transformations.quaternion_matrix(quaternion / np.linalg.norm(quaternion))[:3, :3])


def _paint(
    random: np.random.Generator,
    pictures: SupportsLenAndGetItem[Picture],
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
) -> Part:
    source, faces, normals = compute_normals(vertices, faces)
    vertices = vertices[source]
    colors = np.ones((len(vertices), 4), np.float32)
    colors[:, :3] = shade(normals)[:, None]
    if random.random() < PLAIN:
        grey = random.random() < 0.5
        colors[:, :3] *= random.uniform(0.05, 1) if grey else random.uniform(0, 1, 3)
        return Part(vertices, faces.astype(np.int32), colors)
    return Part(vertices, faces.astype(np.int32), colors, *draw_texture(random, pictures, vertices[:, :2]))


def draw_texture(
    random: np.random.Generator, pictures: SupportsLenAndGetItem[Picture], flat: NDArray[np.float64]
) -> tuple[NDArray[np.float32], Texture]:
    """Draws a picture, its scale and its place. Returns the texture coordinates of vertices, which lie at `flat`
    `(n, 2)` lens pitches, and the texture, which is mirrored beyond its edges.
    """
    picture = pictures[int(random.integers(len(pictures)))]
    texels = np.exp(random.uniform(*np.log(TEXELS)))
    uv = flat * texels / picture.shape[1::-1] + random.uniform(0, 1, 2)
    opaque = np.concatenate([picture, np.full_like(picture[..., :1], 255)], axis=-1)
    return uv.astype(np.float32), Texture(opaque, "mirror", "mirror")


def draw_background(random: np.random.Generator) -> tuple[int, int, int]:
    """Draws the background colour of a scene: black, white, a grey or any colour."""
    kind = random.random()
    if kind < 0.3:
        return (0, 0, 0)
    if kind < 0.55:
        return (255, 255, 255)
    if kind < 0.7:
        level = int(random.integers(0, 256))
        return (level, level, level)
    red, green, blue = random.integers(0, 256, 3).tolist()
    return (red, green, blue)
