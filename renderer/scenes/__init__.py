"""The sample scenes, made by code."""

from ciir.renderer.scenes.registry import SCENES, load_scene

__all__ = ["SCENES", "load_scene"]
