"""A hamburger: the sample scene with many parts, thin sheets, fine texture and vertex colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.scene import Texture
from ciir.renderer.scenes.modelling import (
    blend,
    drop_slivers,
    make_grid_faces,
    revolve,
    rotate_surfaces,
    rotate_vertices,
    sample_curve,
    sample_noise,
    smooth_step,
    to_rgba,
    to_vertex_colors,
)
from ciir.renderer.surface import Surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

_GOLDEN, _BROWN, _CRUMB = (0.88, 0.62, 0.28), (0.62, 0.33, 0.12), (0.96, 0.87, 0.66)
SEEDS = 90


def make_surfaces() -> list[Surface]:
    """Makes bun, lettuce, patty, cheese, tomato and sesame bun, about 2.4 wide and 1.6 high: about 51,000 triangles."""
    layers = [_bottom_bun(), _lettuce(), _patty(), _cheese(), _tomato(-0.34, 0.32), _tomato(0.40, 0.10), *_top_bun()]
    return rotate_surfaces(layers, 0, 16.0)


def _bottom_bun() -> Surface:
    profile = [
        (0, -0.72), (0.9, -0.72), (1.06, -0.64), (1.1, -0.52), (1.07, -0.44), (1.03, -0.42), (1.03, -0.42), (0, -0.42),
    ]  # fmt: skip
    vertices, faces, _ = revolve(sample_curve(profile, 30), 80)
    grain = sample_noise(vertices, frequency=6, octaves=3, seed=1)
    crust = blend(_BROWN, _GOLDEN, (vertices[:, 1] + 0.74) * 5 + 0.4 * grain)
    cut = smooth_step(-0.455, 0.03, vertices[:, 1])
    return Surface(vertices, faces, colors=to_vertex_colors(crust + cut[:, None] * (np.array(_CRUMB) - crust)))


def _patty() -> Surface:
    profile = [(0, -0.34), (0.9, -0.34), (1.06, -0.30), (1.12, -0.20), (1.09, -0.10), (0.95, -0.05), (0, -0.05)]
    vertices, faces, uv = revolve(sample_curve(profile, 48), 104)
    lumps = sample_noise(vertices, frequency=7, octaves=4, seed=2)
    outward = vertices * (1, 0, 1)
    vertices = vertices + (0.09 * lumps)[:, None] * (outward * 0.6 + (0, 0.25, 0))
    v, u = np.meshgrid((np.arange(256) + 0.5) / 256, (np.arange(1024) + 0.5) / 1024, indexing="ij")
    places = np.stack([np.sin(2 * np.pi * u), 3 * v, np.cos(2 * np.pi * u)], axis=-1)
    coarse = sample_noise(places, frequency=9, octaves=4, seed=3)
    fine = sample_noise(places, frequency=45, octaves=2, seed=4)
    meat = blend((0.20, 0.10, 0.06), (0.50, 0.29, 0.18), 0.5 + 0.6 * coarse + 0.25 * fine)
    meat = meat + smooth_step(0.42, 0.15, fine)[..., None] * (np.array((0.72, 0.50, 0.34)) - meat) * 0.6
    return Surface(vertices, faces, uv=uv, texture=Texture(to_rgba(meat[::-1])))


def _lettuce() -> Surface:
    rows, cols = 18, 241
    turn = np.arange(cols) % (cols - 1) * (2 * np.pi / (cols - 1))
    out = np.linspace(0, 1, rows)[:, None]
    ruffle = np.sin(11 * turn) + 0.55 * np.sin(23 * turn + 1.0) + 0.3 * np.sin(5 * turn + 2.0)
    radius = 0.55 + 0.68 * out + 0.05 * out**2 * np.sin(7 * turn + 0.5)
    height = -0.385 - 0.03 * out**3 + 0.06 * out**7 * ruffle + 0.01 * out**7 * np.sin(31 * turn)
    vertices = np.stack(np.broadcast_arrays(radius * np.sin(turn), height, radius * np.cos(turn)), -1).reshape(-1, 3)
    # From the inner rim outwards the sheet faces down, so faces are reversed to make its upper side the outside.
    faces = make_grid_faces(rows, cols)[:, ::-1]
    veins = np.abs(np.sin(8 * turn + 0.8 * np.sin(3 * out * 3))) ** 6 * (1 - 0.6 * out)
    leaf = blend((0.80, 0.88, 0.50), (0.30, 0.58, 0.16), (out + 0.12 * np.sin(17 * turn)).ravel())
    colors = leaf + np.clip(veins, 0, 1).reshape(-1, 1) * (np.array((0.86, 0.93, 0.62)) - leaf) * 0.6
    return Surface(vertices, faces, colors=to_vertex_colors(colors))


def _cheese() -> Surface:
    count, side = 45, 1.0
    x, z = np.meshgrid(np.linspace(-side, side, count), np.linspace(side, -side, count))
    radius = np.hypot(x, z)
    beyond = np.maximum(radius - 1.0, 0)
    # Beyond the patty's edge the sheet bends down and keeps its length, not its width.
    hang = 1.15 * beyond
    shrink = np.where(radius > 0, (np.minimum(radius, 1.0) + 0.5 * beyond) / np.maximum(radius, 1e-9), 1.0) * 1.14
    y = 0.012 * np.sin(3 * x) * np.cos(2.5 * z) - hang
    top = rotate_vertices(np.stack([x * shrink, y, z * shrink], -1).reshape(-1, 3), 1, 20)
    faces = make_grid_faces(count, count)
    under = top - (0, 0.03, 0)
    number = np.arange(count * count).reshape(count, count)
    rim = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    following = np.roll(rim, -1)
    below = rim + count * count, following + count * count
    sides = np.concatenate([np.stack([following, rim, below[1]], 1), np.stack([below[1], rim, below[0]], 1)])
    faces = np.concatenate([faces, faces[:, ::-1] + count * count, sides])
    # The bend is steep, and the rim square.
    return Surface(np.concatenate([top, under]), faces, color=(0.98, 0.72, 0.16, 1.0), crease=75.0)


def _tomato(x: float, z: float) -> Surface:
    profile = [(0, 0.0), (0.66, 0.0), (0.66, 0.0), (0.71, 0.03), (0.71, 0.09), (0.66, 0.12), (0.66, 0.12), (0, 0.12)]
    vertices, faces, _ = revolve(sample_curve(profile, 22), 64)
    uv = vertices[:, [0, 2]] * (1, -1) / 1.44 + 0.5
    return Surface(
        vertices + np.array((x, 0.015, z)), faces, uv=uv, texture=Texture(to_rgba(_slice()), "clamp", "clamp")
    )


def _slice() -> NDArray[np.float64]:
    """Paints a cut tomato, seen from above: `(384, 384, 3)`."""
    y, x = np.meshgrid(np.linspace(1, -1, 384), np.linspace(-1, 1, 384), indexing="ij")
    radius, turn = np.hypot(x, y), np.arctan2(y, x)
    grain = sample_noise(np.stack([x, y, 0 * x], -1), frequency=10, octaves=3, seed=8)
    chamber = np.cos(6 * turn)
    wet = smooth_step(0.1, 0.3, chamber) * smooth_step(0.28, 0.08, radius) * (1 - smooth_step(0.80, 0.06, radius))
    color = blend((0.90, 0.34, 0.24), (0.80, 0.16, 0.10), 0.5 + grain)
    color = color + wet[..., None] * (blend((0.86, 0.48, 0.22), (0.74, 0.26, 0.10), 0.5 + grain) - color)
    seeds = np.zeros_like(radius)
    for ring, count in ((0.48, 24), (0.66, 36)):
        local = (turn / (2 * np.pi) * count) % 1 - 0.5
        seeds = np.maximum(seeds, 1 - ((radius - ring) / 0.055) ** 2 - (local / 0.30) ** 2)
    color = color + (smooth_step(0.2, 0.3, seeds) * wet)[..., None] * (np.array((0.96, 0.86, 0.52)) - color)
    skin = smooth_step(0.955, 0.03, radius)
    cut: NDArray[np.float64] = color + skin[..., None] * (np.array((0.72, 0.07, 0.05)) - color)
    return cut


def _top_bun() -> list[Surface]:
    profile = [
        (0, 0.15), (0.98, 0.15), (1.06, 0.17), (1.12, 0.26), (1.10, 0.42), (0.98, 0.62), (0.72, 0.80), (0.38, 0.89),
        (0, 0.91),
    ]  # fmt: skip
    outline = sample_curve(profile, 52)
    vertices, faces, _ = revolve(outline, 96)
    grain = sample_noise(vertices, frequency=5, octaves=4, seed=5)
    crust = blend(_GOLDEN, _BROWN, (vertices[:, 1] - 0.22) * 1.3 + 0.35 * grain)
    cut = 1 - smooth_step(0.17, 0.03, vertices[:, 1])
    bun = Surface(vertices, faces, colors=to_vertex_colors(crust + cut[:, None] * (np.array(_CRUMB) - crust)))
    return [bun, _sesame(outline)]


def _sesame(outline: NDArray[np.float64]) -> Surface:
    """Makes seeds on the bun's upper side, spaced by the golden angle, each lying flat on it and rotated at random."""
    rng = np.random.default_rng(6)
    crust = outline[outline[:, 1] > 0.45]
    crust = crust[np.argsort(crust[:, 0])]
    radius = np.sqrt((np.arange(SEEDS) + 0.5) / SEEDS) * crust[-1, 0] + rng.uniform(-0.02, 0.02, SEEDS)
    radius = np.clip(radius, 0.02, crust[-1, 0])
    turn = np.arange(SEEDS) * np.pi * (3 - np.sqrt(5)) + rng.uniform(-0.15, 0.15, SEEDS)
    height = np.interp(radius, crust[:, 0], crust[:, 1])
    slope = np.interp(radius, crust[:, 0], np.gradient(crust[:, 1], crust[:, 0]))

    seed, faces, _ = revolve(sample_curve([(0, -1), (0.5, -0.8), (0.75, -0.1), (0.5, 0.65), (0, 1)], 7), 8)
    seed = seed * (0.040, 0.055, 0.020)
    spin = rng.uniform(0, 2 * np.pi, SEEDS)
    around = np.stack([np.cos(turn), 0 * turn, -np.sin(turn)], 1)
    out = np.stack([np.sin(turn), slope, np.cos(turn)], 1) / np.hypot(1, slope)[:, None]
    normal = np.cross(out, around)
    normal *= np.sign(normal[:, 1:2])
    first = np.cos(spin)[:, None] * out + np.sin(spin)[:, None] * around
    second = np.cross(normal, first)
    centre = np.stack([radius * np.sin(turn), height + 0.008, radius * np.cos(turn)], 1)
    # Columns are the images of the seed's x, y and z axes: right-handed, so that outside stays outside.
    frames = np.stack([second, first, np.cross(second, first)], axis=-1)
    placed = np.einsum("sij,vj->svi", frames, seed) + centre[:, None]
    every = (faces[None] + (np.arange(SEEDS) * len(seed))[:, None, None]).reshape(-1, 3)
    vertices = placed.reshape(-1, 3)
    tone = np.repeat(rng.uniform(0, 1, SEEDS), len(seed))
    colors = to_vertex_colors(blend((0.97, 0.92, 0.76), (0.88, 0.78, 0.55), tone))
    return Surface(vertices, drop_slivers(vertices, every), colors=colors)
