"""Renders meshes with OpenGL (`raster`) or Embree (`raytrace`) behind one interface."""

from ciir.renderer.backends.interface import Backend
from ciir.renderer.backends.selection import is_backend_open, open_backend, predict_backend

__all__ = ["Backend", "is_backend_open", "open_backend", "predict_backend"]
