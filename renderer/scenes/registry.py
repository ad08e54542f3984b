"""The three sample scenes by name, of rising complexity: plain, textured, and with many parts."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.placement import AS_GIVEN
from ciir.renderer.readers.names import clean_text
from ciir.renderer.scenes import globe, hamburger, vase
from ciir.renderer.surface import assemble_scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.placement import Placement
    from ciir.renderer.scene import Scene
    from ciir.renderer.surface import Surface

SCENES: dict[str, Callable[[], list[Surface]]] = {
    "vase": vase.make_surfaces,
    "globe": globe.make_surfaces,
    "hamburger": hamburger.make_surfaces,
}
"""Functions that make each scene's surfaces, by the scene's name; on the command line `scene:NAME`."""


def load_scene(name: str, placement: Placement = AS_GIVEN) -> Scene:
    """Returns the sample scene called `name`, lit as it will be placed; the most recent ones are kept.

    Raises `InvalidOption` for a name that is not in `SCENES`.
    """
    if name not in SCENES:
        raise InvalidOption(f"scene:{clean_text(name)}: no such scene; the scenes are {', '.join(SCENES)}")
    return _light_scene(name, tuple(placement.light_direction()))


@lru_cache(maxsize=8)
def _light_scene(name: str, light: tuple[float, ...]) -> Scene:
    return assemble_scene(_make_surfaces(name), name=f"scene:{name}", light=np.array(light))


@cache
def _make_surfaces(name: str) -> list[Surface]:
    """Makes the surfaces and keeps them, since a turned scene is lit anew: painting the globe takes a second, lighting
    it a fiftieth.
    """
    return SCENES[name]()
