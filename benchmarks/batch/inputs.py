"""Makes any number of elemental image arrays and meshes from the shipped scenes and simple shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import trimesh

from ciir.renderer.writers.pictures import encode_png
from ciir.service.interface import render

if TYPE_CHECKING:
    from pathlib import Path

SCENES = ("scene:vase", "scene:globe", "scene:hamburger")
COLOURS = ((0, 1, 2), (2, 0, 1), (1, 2, 0))
"""Orders of the channels."""


def write_inputs(folder: Path, arrays: int, meshes: int, lenses: int, pixels: int) -> None:
    """Writes PNGs and GLBs, all of them different, unless they exist already."""
    folder.mkdir(parents=True, exist_ok=True)
    rendered = {}
    for number in range(arrays):
        path = folder / f"array_{number:03d}.png"
        if path.exists():
            continue
        scene = SCENES[number % len(SCENES)]
        if scene not in rendered:
            rendered[scene] = render(scene, lenses=(lenses, lenses), pixels=(pixels, pixels)).eia()
        turned = np.roll(rendered[scene], pixels * number, axis=1)[..., COLOURS[number // len(SCENES) % len(COLOURS)]]
        path.write_bytes(encode_png(np.ascontiguousarray(turned, np.uint8)))
    for number in range(meshes):
        path = folder / f"mesh_{number:03d}.glb"
        if not path.exists():
            path.write_bytes(_make_mesh(number))


def _make_mesh(seed: int) -> bytes:
    """Makes a ball with bumps, in colours."""
    random = np.random.default_rng(seed)
    mesh = trimesh.creation.icosphere(subdivisions=5)
    waves = random.normal(size=(4, 3)) * 3
    heights = np.sin(mesh.vertices @ waves.T)
    mesh.vertices = mesh.vertices * (1 + 0.1 * heights.mean(axis=1, keepdims=True))
    mesh.visual.vertex_colors = np.rint(127 * (1 + heights[:, :3])).astype(np.uint8)
    data: bytes = mesh.export(file_type="glb")
    return data
