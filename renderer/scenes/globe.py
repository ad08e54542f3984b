"""A globe on its stand: the sample scene with rich texture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.scene import Texture
from ciir.renderer.scenes.modelling import (
    blend,
    make_torus,
    revolve,
    rotate_surfaces,
    rotate_vertices,
    sample_curve,
    sample_noise,
    smooth_step,
    to_rgba,
)
from ciir.renderer.surface import Surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEIGHT, WIDTH = 720, 1440
_BRASS = (0.78, 0.60, 0.30, 1.0)
_WOOD = (0.42, 0.24, 0.14, 1.0)
_SEA_LEVEL = 0.03
# 5x7 letters, a byte for each column, lowest bit at the top.
_LETTERS = {
    "A": "7e1111117e", "B": "7f49494936", "C": "3e41414122", "D": "7f4141221c", "E": "7f49494941", "F": "7f09090901",
    "G": "3e4149497a", "H": "7f0808087f", "I": "00417f4100", "L": "7f40404040", "M": "7f020c027f", "N": "7f0408107f",
    "O": "3e4141413e", "P": "7f09090906", "R": "7f09192946", "S": "4649494931", "T": "01017f0101", "U": "3f4040403f",
    "V": "1f2040201f", "W": "3f4038403f", "X": "6314081463", "Y": "0708700807", " ": "0000000000",
}  # fmt: skip
_LABELS = (  # text, longitude and latitude of its middle in degrees, pixels per dot of the letters
    ("LIGHT FIELD", -20, 52, 3), ("OCEAN OF RAYS", 20, -8, 3), ("LENS BAY", 62, 28, 2), ("PIXEL ISLES", -62, 18, 2),
    ("GAP STRAIT", -48, -32, 2), ("PITCH RANGE", 52, -40, 2), ("NORTH VIEW", 5, 74, 2), ("APERTURE", 140, 10, 3),
    ("DEPTH PLAIN", -140, -15, 3), ("FOCUS", 8, 22, 2), ("CAPE MOIRE", -8, -52, 2), ("PARALLAX", 175, 45, 3),
)  # fmt: skip


def make_surfaces() -> list[Surface]:
    """Makes the globe, of radius 1 about the origin, its meridian ring and its foot: about 26,000 triangles."""
    polar = np.linspace(-np.pi / 2, np.pi / 2, 65)
    vertices, faces, uv = revolve(np.stack([np.cos(polar) * (np.abs(polar) < 1.57), np.sin(polar)], 1), 128)
    globe = Surface(
        rotate_vertices(vertices, 1, 180), faces, uv=uv, texture=Texture(to_rgba(paint_texture()), wrap_v="clamp")
    )
    ring_vertices, ring_faces = make_torus(1.1, 0.035, 96, 16)
    axis_vertices, axis_faces, _ = revolve([(0, -1.2), (0.05, -1.2), (0.05, -1), (0.05, 1), (0.05, 1.2), (0, 1.2)], 24)
    turning = rotate_surfaces(
        [globe, Surface(ring_vertices, ring_faces, color=_BRASS), Surface(axis_vertices, axis_faces, color=_BRASS)],
        2,
        -23.4,
    )
    foot_profile = [
        (0, -1.72), (0.56, -1.72), (0.62, -1.70), (0.64, -1.66), (0.56, -1.60), (0.30, -1.54), (0.12, -1.46),
        (0.09, -1.34), (0.12, -1.22), (0.10, -1.13), (0.0, -1.12),
    ]  # fmt: skip
    foot_vertices, foot_faces, _ = revolve(sample_curve(foot_profile, 48), 64)
    return rotate_surfaces([*turning, Surface(foot_vertices, foot_faces, color=_WOOD)], 0, 14.0)


def paint_texture() -> NDArray[np.float32]:
    """Paints the map, `(HEIGHT, WIDTH, 3)` in [0, 1], north up: land and sea, graticule, a dashed track and labels."""
    longitude, latitude = np.meshgrid(
        (np.arange(WIDTH, dtype=np.float32) + 0.5) / WIDTH * 360 - 180,
        90 - (np.arange(HEIGHT, dtype=np.float32) + 0.5) / HEIGHT * 180,
    )
    east, north = np.radians(longitude), np.radians(latitude)
    places = np.stack([np.cos(north) * np.sin(east), np.sin(north), np.cos(north) * np.cos(east)], axis=-1)
    height = sample_noise(places, frequency=1.7, octaves=5, seed=11)
    fine = sample_noise(places, frequency=40, octaves=1, seed=40)

    sea = blend((0.05, 0.16, 0.36), (0.28, 0.62, 0.72), (height + 0.5) / (0.5 + _SEA_LEVEL))
    land = blend((0.36, 0.55, 0.24), (0.80, 0.70, 0.46), (height - _SEA_LEVEL) * 4 + fine * 0.25)
    land = _over(land, (0.50, 0.38, 0.28), smooth_step(0.27, 0.12, height + fine * 0.05))
    contours = np.abs((height * 28) % 1 - 0.5) < 0.07
    land = _over(land, (0.35, 0.30, 0.18), contours * 0.5)
    picture = np.where((height > _SEA_LEVEL)[..., None], land * (1 + 0.15 * fine[..., None]), sea)
    ice = smooth_step(68, 6, np.abs(latitude) + 8 * sample_noise(places, frequency=5, octaves=2, seed=70))
    picture = _over(picture, (0.94, 0.96, 0.98), ice)
    shore = np.abs(height - _SEA_LEVEL) < 0.008
    picture = _over(picture, (0.12, 0.16, 0.20), shore * 0.8)

    for spacing, width, strength in ((15, 0.22, 0.55), (90, 0.45, 0.9)):
        across = np.abs((latitude + spacing / 2) % spacing - spacing / 2) < width
        along = np.abs((longitude + spacing / 2) % spacing - spacing / 2) * np.cos(north) < width
        picture = _over(picture, (0.97, 0.95, 0.86), (across | along & (np.abs(latitude) < 80)) * strength)
    track = 30 * np.sin(east * 2 + 0.6)
    dashes = (np.abs(latitude - track) < 0.9) & (longitude % 6 < 3.6)
    picture = _over(picture, (0.86, 0.14, 0.16), dashes * 1.0)
    scale = (np.abs(np.abs(latitude) - 60) < 1.2) & ((longitude % 10 < 5) ^ (np.abs(latitude) > 60))
    picture = _over(picture, (0.10, 0.10, 0.12), scale * 0.85)

    ink = np.zeros((HEIGHT, WIDTH), bool)
    for text, middle, above, dot in _LABELS:
        _write(ink, text, middle, above, dot)
    halo = ink.copy()
    for shift in (-1, 1):
        for axis in (0, 1):
            halo |= np.roll(ink, shift, axis)
    picture = _over(picture, (0.98, 0.96, 0.88), halo * 0.8)
    return np.clip(_over(picture, (0.08, 0.06, 0.10), ink * 1.0), 0, 1)


def _over(
    picture: NDArray[np.float32], color: tuple[float, float, float], cover: NDArray[np.floating]
) -> NDArray[np.float32]:
    return picture + cover[..., None].astype(np.float32) * (np.array(color, np.float32) - picture)


def _write(ink: NDArray[np.bool_], text: str, longitude: float, latitude: float, dot: int) -> None:
    """Sets the text's pixels in the mask, wider towards the poles so that letters keep their shape on the sphere."""
    columns = np.frombuffer(bytes.fromhex("".join(_LETTERS[letter] + "00" for letter in text)), np.uint8)
    dots = (columns[None, :] >> np.arange(7)[:, None] & 1).astype(bool)
    wide = max(1, round(dot / np.cos(np.radians(latitude))))
    letters = dots.repeat(dot, axis=0).repeat(wide, axis=1)
    top = round((90 - latitude) / 180 * HEIGHT) - letters.shape[0] // 2
    left = round((longitude + 180) / 360 * WIDTH) - letters.shape[1] // 2
    ink[top : top + letters.shape[0], (left + np.arange(letters.shape[1])) % WIDTH] |= letters
