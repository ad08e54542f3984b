"""Rendering backends, and scenes in front of a lens array for them."""

import numpy as np
import pytest

from ciir.errors import BackendUnavailable
from ciir.renderer.backends import Backend, open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.placement import AS_GIVEN, Placement
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read
from ciir.renderer.scene import Scene
from ciir.renderer.scenes import SCENES, load_scene
from tests.support.paths import SHARED

BACKENDS = ["raster", "raytrace"]
ARRAY = LensArray(50, 50, 15, 15)


def require_backend(name: str) -> Backend:
    """Opens the backend called `name`. Skips the test if it doesn't run."""
    try:
        return open_backend(name)[0]
    except BackendUnavailable as error:
        pytest.skip(str(error))


def place_scene(name: str, array: LensArray = ARRAY, placement: Placement = AS_GIVEN) -> Scene:
    """Places a sample scene, or a mesh file of ../shared, at `array`. Skips the test if ../shared is missing."""
    if name in SCENES:
        found = load_scene(name)
    elif SHARED.is_dir():
        found = read(Bundle.from_path(SHARED / "data" / "meshes" / name))
        assert isinstance(found, Scene)
    else:
        pytest.skip("needs ../shared")
    return found.transform(frame_scene(found, array, placement))


def find_disagreements(one, other, *, textured):
    """Lists the differences that are out of bounds between two sets of RGBA views `(n, rows, cols, 4)`. `other` is the
    exact one.
    """
    errors = []
    mask, exact = one[..., 3] > 0, other[..., 3] > 0
    edge = np.zeros_like(exact)
    for axis in (1, 2):
        step = np.diff(exact, axis=axis)
        before, after = [slice(None)] * 3, [slice(None)] * 3
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        edge[tuple(before)] |= step
        edge[tuple(after)] |= step
    differ = mask != exact
    # OpenGL snaps vertices to 1/256 of a pixel. About 1 in 100 edge pixels has its centre within that of the edge.
    if differ.sum() > 0.02 * edge.sum():
        errors.append(f"silhouette: {differ.sum()} of {edge.sum()} pixels at the edge differ")
    signed = int(mask.sum()) - int(exact.sum())
    if abs(signed) > max(3.0, 3.0 * np.sqrt(differ.sum())):
        errors.append(f"silhouette: biased by {signed} pixels of {differ.sum()}")
    inside = mask & exact
    error = (one[..., :3].astype(int) - other[..., :3])[inside]
    if textured:
        if np.abs(error).mean() > 2.0:
            errors.append(f"texture: mean absolute difference {np.abs(error).mean():.2f}")
        if np.abs(error.mean(0)).max() > 0.3:
            errors.append(f"texture: bias {error.mean(0)}")
    elif (np.abs(error).max(-1) <= 3).mean() < 0.995:
        errors.append(f"colour: {(np.abs(error).max(-1) > 3).mean():.4f} of the pixels differ by more than 3")
    return errors
