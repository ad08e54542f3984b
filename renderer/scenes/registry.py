"""The three sample scenes by name, of rising complexity: plain, textured, of many parts."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.readers.names import clean_text
from ciir.renderer.scenes import globe, hamburger, vase
from ciir.renderer.surface import assemble_scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.scene import Scene
    from ciir.renderer.surface import Surface

SCENES: dict[str, Callable[[], list[Surface]]] = {
    "vase": vase.make_surfaces,
    "globe": globe.make_surfaces,
    "hamburger": hamburger.make_surfaces,
}
"""Makes each scene's surfaces, by the scene's name; on the command line `scene:NAME`."""


@cache
def load_scene(name: str) -> Scene:
    """The sample scene called `name`, made once. Raises `InvalidOption` for a name that is not in `SCENES`."""
    if name not in SCENES:
        raise InvalidOption(f"scene:{clean_text(name)}: no such scene; the scenes are {', '.join(SCENES)}")
    return assemble_scene(SCENES[name](), name=f"scene:{name}")
