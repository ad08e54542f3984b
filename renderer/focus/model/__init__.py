"""The captured scene as a model: points and triangles with the colours that the views show, written as PLY and GLB."""

from ciir.renderer.focus.model.files import encode_model
from ciir.renderer.focus.model.model import Model, make_model

__all__ = ["Model", "encode_model", "make_model"]
