"""The rim of what views show in front of a background, where pixels are means of both."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.light_field import LightField


def read_picture(view: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float64]:
    """Returns RGB of a view with any channels, `(H, W, 3)`, from 0 to 255."""
    colours = view[..., :1] if view.shape[2] < 3 else view[..., :3]
    return np.broadcast_to(colours / (np.iinfo(view.dtype).max / 255), (*view.shape[:2], 3))


def clear_rim(picture: NDArray[np.float64], is_shown: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Returns `picture` `(H, W, 3)` with the background's black removed from the pixels next to it, where lenses
    average both.

    These pixels take the lighter of their own colour and that of the nearest pixel inside.
    """
    is_inner = ndimage.binary_erosion(is_shown, np.ones((3, 3)), border_value=1)
    if is_inner.all() or not is_inner.any():
        return picture
    nearest = ndimage.distance_transform_edt(~is_inner, return_distances=False, return_indices=True)
    cleared: NDArray[np.float64] = np.maximum(picture, picture[tuple(nearest)])
    return cleared


def find_coverage(field: LightField, is_shown: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Returns how much of each pixel shows no background, `(V, U, H, W)`: its light as a share of that of
    `clear_rim`.
    """
    coverage = is_shown.astype(np.float32)
    for view in np.ndindex(is_shown.shape[:2]):
        picture = read_picture(field.views[view])
        light, cleared = picture.max(axis=2), clear_rim(picture, is_shown[view]).max(axis=2)
        coverage[view] *= np.divide(light, cleared, out=np.ones_like(light), where=cleared > 0)
    return coverage
