"""Selects the backend that renders a scene: the one named, or the cheaper one."""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING

from ciir.errors import BackendUnavailable, InvalidOption

if TYPE_CHECKING:
    from ciir.renderer.backends.interface import Backend

FEW_RAYS = 1 << 14
"""Up to this many rays, a view is cast whatever the scene: they take about 4 ms, and OpenGL takes 200 ms to start."""

FORKED = (
    "OpenGL was started before this process was forked, and would hang here; start processes by spawn or forkserver "
    '(multiprocessing.get_context("spawn")), or give backend raytrace'
)

_lock = threading.Lock()
_open: dict[str, Backend] = {}
_refused: dict[str, str] = {}
"""Why a backend can't run, as text: keeping the exception would keep its callers' frames alive."""


def open_backend(name: str, *, triangles: int = 0, rays: int = 0, is_see_through: bool = False) -> tuple[Backend, str]:
    """Returns the backend called `name`, opened once per process, and the reason for it in one line for the report.

    `auto` takes the cheaper one for a scene of `triangles` and views of `rays` samples each: OpenGL's cost grows with
    the triangles, Embree's with the rays, at about the same rate as measured. The number of views has no influence, so
    that a single view equals the same view of an elemental image array. If OpenGL doesn't work, and for see-through
    materials, which it can't blend in order, `auto` takes `raytrace`.

    Raises `BackendUnavailable` if `name` is `raster` and OpenGL doesn't work, `InvalidOption` for unknown names.
    """
    if name in ("raster", "raytrace"):
        return _open_once(name), f"{name}: asked for"
    if name != "auto":
        raise InvalidOption(f"backend: {name!r} is not known; give auto, raster or raytrace")
    if is_see_through:
        return _open_once("raytrace"), "raytrace: rays blend the see-through materials in order"
    if _is_cheap_to_cast(rays, triangles):
        reason = f"raytrace: {rays:,} rays a view cost less to cast than {triangles:,} triangles to draw"
        return _open_once("raytrace"), reason
    try:
        backend = _open_once("raster")
    except BackendUnavailable as error:
        return _open_once("raytrace"), f"raytrace: OpenGL can't be used here ({error})"
    return backend, f"raster: {rays:,} rays a view cost more to cast than {triangles:,} triangles to draw"


def predict_backend(name: str, *, triangles: int, rays: int, is_see_through: bool = False) -> str:
    """Returns the name of the backend that `open_backend` returns where OpenGL works, without opening it."""
    if name != "auto":
        return name
    return "raytrace" if is_see_through or _is_cheap_to_cast(rays, triangles) else "raster"


def _is_cheap_to_cast(rays: int, triangles: int) -> bool:
    return rays <= max(triangles, FEW_RAYS)


def _open_once(name: str) -> Backend:
    """Returns the process's only backend of this name. A refusal is final: a running process can't gain OpenGL."""
    with _lock:
        if name not in _open and name not in _refused:
            try:
                if name == "raster":
                    from ciir.renderer.backends.raster import RasterBackend

                    _open[name] = RasterBackend()
                else:
                    from ciir.renderer.backends.raytrace import RaytraceBackend

                    _open[name] = RaytraceBackend()
            except BackendUnavailable as error:
                _refused[name] = str(error)
        if name in _refused:
            raise BackendUnavailable(_refused[name])
        return _open[name]


def _refuse_inherited() -> None:
    """Refuses OpenGL in a forked process if its parent started it, because the threads that draw weren't forked."""
    if "raster" in _open:
        _refused["raster"] = FORKED
    _lock.release()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_refuse_inherited)
