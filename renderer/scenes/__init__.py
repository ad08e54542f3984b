"""Three sample scenes made by code, of rising complexity: a plain object, a richly textured one, a hamburger."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.readers.names import clean_text
from ciir.renderer.scenes import globe, hamburger
from ciir.renderer.scenes.modelling import curve, revolve, tilted
from ciir.renderer.surface import Surface, assemble

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.scene import Scene


def vase() -> Scene:
    """A turned vase of one plain colour, open at the top: nothing but shape and light. About 25,000 triangles."""
    profile = [
        (0, -1.2), (0.46, -1.2), (0.46, -1.2), (0.50, -1.14), (0.42, -1.06), (0.52, -0.88), (0.76, -0.48),
        (0.86, 0.0), (0.72, 0.46), (0.42, 0.78), (0.31, 0.98), (0.36, 1.14), (0.54, 1.24), (0.56, 1.28), (0.52, 1.29),
        (0.32, 1.14), (0.26, 0.98), (0.37, 0.74), (0.60, 0.44), (0.60, -0.4), (0.2, -1.0), (0, -1.05),
    ]  # fmt: skip
    vertices, faces, _ = revolve(curve(profile, 132), 96)
    return assemble(tilted([Surface(vertices, faces, color=(0.45, 0.68, 0.72, 1.0))], 0, 20.0), name="scene:vase")


SCENES: dict[str, Callable[[], Scene]] = {
    "vase": vase,
    "globe": lambda: assemble(globe.surfaces(), name="scene:globe"),
    "hamburger": lambda: assemble(hamburger.surfaces(), name="scene:hamburger"),
}
"""What makes each scene, by its name; on the command line `scene:NAME`."""


@cache
def scene(name: str) -> Scene:
    """The sample scene called `name`, made once. Raises `InvalidOption` for a name that isn't in `SCENES`."""
    if name not in SCENES:
        raise InvalidOption(f"scene:{clean_text(name)}: no such scene; the scenes are {', '.join(SCENES)}")
    return SCENES[name]()
