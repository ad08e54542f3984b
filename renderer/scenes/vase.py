"""A vase: the sample scene with one plain colour."""

from __future__ import annotations

from ciir.renderer.scenes.modelling import revolve, rotate_surfaces, sample_curve
from ciir.renderer.surface import Surface


def make_surfaces() -> list[Surface]:
    """Makes a vase of one colour, open at the top, that shows only shape and light. About 25,000 triangles."""
    profile = [
        (0, -1.2), (0.46, -1.2), (0.46, -1.2), (0.50, -1.14), (0.42, -1.06), (0.52, -0.88), (0.76, -0.48),
        (0.86, 0.0), (0.72, 0.46), (0.42, 0.78), (0.31, 0.98), (0.36, 1.14), (0.54, 1.24), (0.56, 1.28), (0.52, 1.29),
        (0.32, 1.14), (0.26, 0.98), (0.37, 0.74), (0.60, 0.44), (0.60, -0.4), (0.2, -1.0), (0, -1.05),
    ]  # fmt: skip
    vertices, faces, _ = revolve(sample_curve(profile, 132), 96)
    return rotate_surfaces([Surface(vertices, faces, color=(0.45, 0.68, 0.72, 1.0))], 0, 20.0)
