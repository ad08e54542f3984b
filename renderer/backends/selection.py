"""Which backend renders a scene: the one named, or the cheaper one."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from ciir.errors import BackendUnavailable, InvalidOption

if TYPE_CHECKING:
    from ciir.renderer.backends.interface import Backend

FEW_RAYS = 1 << 14
"""Rays of a view that are cast whatever the scene: they take some 4 ms, and OpenGL takes most of a second to start."""

_lock = threading.Lock()
_open: dict[str, Backend] = {}
_refused: dict[str, str] = {}
"""Why a backend can't run: the words, since an exception that is kept would keep its callers' frames alive."""


def _opened(name: str) -> Backend:
    """The one backend of this name in this process. A refusal stands: OpenGL does not appear while we run."""
    with _lock:
        if name not in _open and name not in _refused:
            try:
                if name == "raster":
                    from ciir.renderer.backends.raster import RasterBackend

                    _open[name] = RasterBackend()
                else:
                    from ciir.renderer.backends.embree import RaytraceBackend

                    _open[name] = RaytraceBackend()
            except BackendUnavailable as error:
                _refused[name] = str(error)
        if name in _refused:
            raise BackendUnavailable(_refused[name])
        return _open[name]


def is_backend_open(name: str) -> bool:
    """Whether this process has opened the backend already, so that it need not be started."""
    return name in _open


def predict_backend(name: str, *, triangles: int, rays: int) -> str:
    """The name of the backend that `open_backend` will take, as far as that is known without opening one."""
    if name != "auto":
        return name
    return "raytrace" if _are_cheap(rays, triangles) or "raster" in _refused else "raster"


def _are_cheap(rays: int, triangles: int) -> bool:
    return rays <= max(triangles, FEW_RAYS)


def open_backend(name: str, *, triangles: int = 0, rays: int = 0) -> tuple[Backend, str]:
    """The backend that `name` asks for, and why it was taken, in one line for the report.

    `auto` takes the cheaper one for a scene of `triangles` and views of `rays` samples: rasterising costs by the
    triangle and casting by the ray, about the same for each as measured; up to `FEW_RAYS` rays are cast in any
    case. The choice doesn't depend on how many views there are, so that a view alone equals the same
    view out of an elemental image array. Where OpenGL doesn't work `auto` takes `raytrace`.

    Raises `BackendUnavailable` where `raster` is asked for and OpenGL doesn't work, `InvalidOption` for any other name.
    """
    if name in ("raster", "raytrace"):
        return _opened(name), f"{name}: asked for"
    if name != "auto":
        raise InvalidOption(f"backend: {name!r} is not known; give auto, raster or raytrace")
    if _are_cheap(rays, triangles):
        return _opened(
            "raytrace"
        ), f"raytrace: {rays:,} rays a view are cheap to cast in a scene of {triangles:,} triangles"
    try:
        return _opened("raster"), f"raster: {rays:,} rays a view cost more to cast than {triangles:,} triangles to draw"
    except BackendUnavailable as error:
        return _opened("raytrace"), f"raytrace: OpenGL doesn't work on this machine ({error})"
