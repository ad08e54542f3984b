"""Apertures: the views that a plane is made from, and how much each of them counts."""

from __future__ import annotations

from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from ciir.errors import InvalidOption

if TYPE_CHECKING:
    from numpy.typing import NDArray

Shape = Literal["disc", "square", "gauss"]


def make_aperture(grid: tuple[int, ...], radius: float, shape: Shape = "disc") -> NDArray[np.float32]:
    """Returns the weights `(V, U)` of the views around the middle of the grid.

    `disc` and `square`: 1 inside, half at `radius` views from the middle. `gauss`: all views, weighted by
    `exp(-2 * (distance / radius)**2)`, as the radius of a beam is defined (ISO 11146).

    Raises `InvalidOption` if no view counts.
    """
    v, u = (np.arange(count)[:, np.newaxis] - (count - 1) / 2 for count in grid)
    distance = np.maximum(np.abs(v), np.abs(u.T)) if shape == "square" else np.hypot(v, u.T)
    weights = np.clip(radius + 0.5 - distance, 0, 1)
    if shape == "gauss":
        weights = np.exp(-2 * np.square(distance / radius)) if radius > 0 else np.zeros(grid)
    result: NDArray[np.float32] = weights.astype(np.float32)
    if not result.any():
        raise InvalidOption(f"aperture: a radius of {radius:g} views lets no view through; give 0.5 or more")
    return result


def read_aperture(
    aperture: float | NDArray[Any] | None, grid: tuple[int, ...], shape: Shape = "disc"
) -> NDArray[np.float32]:
    """Returns the weights of an aperture given as a radius in views, as weights, or as None for all views.

    Raises `InvalidOption` if `make_aperture` or `check_weights` does, for an unknown shape, and for anything else.
    """
    if shape not in get_args(Shape):
        raise InvalidOption(f"shape: {shape!r} is not known; give {', '.join(get_args(Shape))}")
    if aperture is None or isinstance(aperture, np.ndarray):
        return check_weights(aperture, grid)
    if not isinstance(aperture, Real) or np.isnan(float(aperture)):
        raise InvalidOption(
            f"aperture: {str(aperture)[:40]!r} is not a number; give a radius in views, such as 1.5, or an array of "
            "weights"
        )
    return make_aperture(grid, float(aperture), shape)


def check_weights(weights: NDArray[Any] | None, grid: tuple[int, ...]) -> NDArray[np.float32]:
    """Returns the weights of views, by default all 1.

    Raises `InvalidOption` for weights of another shape than `grid`, below 0, not finite, or all 0.
    """
    if weights is None:
        return np.ones(grid, np.float32)
    if weights.shape != grid or not np.isfinite(weights).all() or weights.min() < 0 or weights.max() == 0:
        what = (
            f"an array of shape {weights.shape}" if weights.shape != grid else "numbers below 0, not finite, or all 0"
        )
        raise InvalidOption(
            f"aperture: {what} can't weigh {grid[0]}x{grid[1]} views; give {grid[0]}x{grid[1]} numbers from 0, one for "
            "each view, not all of them 0, or a radius in views"
        )
    return weights.astype(np.float32)
