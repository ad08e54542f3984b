"""Computational integral imaging reconstruction: reads, renders, upscales and writes light fields.

::

    import ciir

    light_field = ciir.render("scene:vase", lenses=(50, 50))
    ciir.upscale(light_field).save("views.zip")

Names are imported when they are first used, which keeps `import ciir` fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str
    from ciir.errors import (
        BackendUnavailable,
        Error,
        InputError,
        InvalidGeometry,
        InvalidOption,
        ModelError,
        TooLarge,
        Unreadable,
        UnsupportedType,
    )
    from ciir.renderer.focus.depth_scale import DepthScale
    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.light_field import LightField
    from ciir.service.interface import Reconstruction, open, reconstruct, render, upscale  # noqa: A004 - as in Pillow

_MODULES = {
    "DepthScale": "ciir.renderer.focus.depth_scale",
    "LensArray": "ciir.renderer.lens_array",
    "LightField": "ciir.renderer.light_field",
    **dict.fromkeys(("Reconstruction", "open", "reconstruct", "render", "upscale"), "ciir.service.interface"),
}
"""The modules of names in `__all__`; names not listed here are errors in `ciir.errors`."""
__all__ = [
    "BackendUnavailable",
    "DepthScale",
    "Error",
    "InputError",
    "InvalidGeometry",
    "InvalidOption",
    "LensArray",
    "LightField",
    "ModelError",
    "Reconstruction",
    "TooLarge",
    "Unreadable",
    "UnsupportedType",
    "__version__",
    "open",
    "reconstruct",
    "render",
    "upscale",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version("ciir")
    if name not in __all__:
        raise AttributeError(f"module 'ciir' has no attribute {name!r}")
    return getattr(import_module(_MODULES.get(name, "ciir.errors")), name)


def __dir__() -> list[str]:
    return __all__
