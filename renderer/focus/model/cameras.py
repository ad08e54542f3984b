"""Places a model in front of the cameras that captured it, at its depths, in perspective.

A model is made in the coordinates of a lens array, in which `-z` is in proportion to disparity. From there to the
coordinates of cameras is a projective map, so triangles stay flat and views show the same.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.focus.depth_scale import DepthScale

if TYPE_CHECKING:
    from ciir.renderer.focus.model.model import Model
    from ciir.renderer.views import DepthSense

LEAST_DISPARITY = 0.05
"""Pixels per view from what is infinitely far, below which a depth is not known: maps of clean views err by as much."""


def check_cameras(cameras: DepthScale) -> None:
    """Raises `InvalidOption` for anything but what `DepthScale.from_cameras` returns."""
    if not isinstance(cameras, DepthScale) or not cameras.is_inverse or cameras.tangent is None:
        raise InvalidOption("cameras: not the geometry of a camera array; give what DepthScale.from_cameras returns")


def place_before_cameras(model: Model, cameras: DepthScale, sense: DepthSense, aspect: float = 1.0) -> Model:
    """Returns `model` in the unit of the cameras' distances: the middle of their grid is the origin, x goes to the
    right, y up, and `-z` is the depth.

    `cameras`: of the views that the model was made from, in their depth sense, `sense`. `aspect`: width / height of a
    pixel. Triangles of less than `LEAST_DISPARITY` from what is infinitely far are left out, with a note. Raises
    `InvalidOption` if these are all.
    """
    check_cameras(cameras)
    array, sign = model.array, 1 if sense == "lenses" else -1
    disparity = -sign * model.vertices[:, 2] * array.delta / array.pitch
    is_known = (disparity - cameras.offset) * np.sign(cameras.factor) >= LEAST_DISPARITY
    depth = cameras.to_depth(np.where(is_known, disparity, cameras.factor + cameras.offset))
    scale = np.array([1, 1 / aspect]) * cameras.tangent / array.pitch
    vertices = np.column_stack([model.vertices[:, :2] * scale * depth[:, np.newaxis], -depth])
    faces = model.faces[is_known[model.faces].all(axis=1)]
    if not len(faces):
        raise InvalidOption(
            "all disparities are those of content beyond infinity; check the geometry of the cameras and the depth "
            "sense; if the pictures were aligned at a depth, give it with convergence (in Python zero)"
        )
    share = 1 - len(faces) / len(model.faces)
    note = (
        f"{100 * share:.2g} % of the triangles are left out: disparity is less than {LEAST_DISPARITY:g} pixels from "
        "that of infinity; if the pictures were aligned at a depth, give it with convergence (in Python zero)"
    )
    return replace(model, vertices=vertices, faces=faces, notes=(*model.notes, *[note] * (share > 0)))
