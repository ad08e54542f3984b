"""Renders meshes with OpenGL (`raster`) or Embree (`raytrace`) behind one interface."""

from ciir.renderer.backends.interface import Backend
from ciir.renderer.backends.selection import open_backend, predict_backend

__all__ = ["Backend", "open_backend", "predict_backend"]
