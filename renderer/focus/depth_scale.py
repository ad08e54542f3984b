"""Converts between a plane's depth and its disparity, which a lens array or the cameras of an array relate."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.views import check_depth_sense

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.views import DepthSense


@dataclass(frozen=True)
class DepthScale:
    """Disparity, in pixels per view, of content at a depth.

    Parallel rays (`is_inverse` False): `factor * depth + offset`; cameras: `factor / depth + offset`.
    """

    factor: float
    is_inverse: bool
    offset: float = 0.0
    tangent: float | None = None
    """Cameras: tangent of the angle between the middle of a picture and the next pixel; None if it is unknown."""

    @classmethod
    def from_lenses(cls, array: LensArray, sense: DepthSense = "lenses") -> DepthScale:
        """Returns the scale in front of a lens array: depths along -z in scene units, `delta * depth / pitch` pixels.

        `sense`: the depth sense of the light field; with `cameras` its views are in reverse order.
        """
        check_depth_sense(sense)
        factor = array.delta / array.pitch
        return cls(factor if sense == "lenses" else -factor, is_inverse=False)

    @classmethod
    def from_cameras(
        cls,
        pitch: float,
        focal_length: float,
        sensor_width: float,
        columns: int,
        *,
        zero: float = np.inf,
        sense: DepthSense = "cameras",
    ) -> DepthScale:
        """Returns the scale of a camera array: `columns * focal_length / sensor_width * pitch * (1 / depth - 1 / zero)`
        pixels.

        `pitch`: from camera to camera; depths are in its unit, from the plane of the cameras. `focal_length` and
        `sensor_width`: in the same unit; `columns`: pixels across. `zero`: the depth at which aligned pictures have no
        disparity (infinity for parallel cameras). `sense`: the depth sense of the light field; with `lenses` its views
        are in reverse order.

        Raises `InvalidOption` if one of them is not a positive number, and for an unknown depth sense.
        """
        check_depth_sense(sense)
        given = {"pitch": pitch, "focal_length": focal_length, "sensor_width": sensor_width, "columns": columns}
        for name, number in (given | {"zero": zero}).items():
            if not isinstance(number, Real) or not number > 0 or (name != "zero" and not np.isfinite(float(number))):
                raise InvalidOption(f"{name}: {number!r} is out of range; give a positive number")
        factor = columns * focal_length / sensor_width * pitch * (1 if sense == "cameras" else -1)
        return cls(factor, is_inverse=True, offset=-factor / zero, tangent=sensor_width / (columns * focal_length))

    def to_disparity(self, depth: ArrayLike) -> NDArray[np.float64]:
        """Returns the disparity at `depth`, of any shape."""
        depth = np.asarray(depth, np.float64)
        with np.errstate(divide="ignore"):
            return self.factor * (1 / depth if self.is_inverse else depth) + self.offset

    def to_depth(self, disparity: ArrayLike) -> NDArray[np.float64]:
        """Returns the depth of `disparity`, of any shape; infinite, or negative, if cameras see nothing with it.

        `disparity`: in the depth sense of this scale. Files, and `DisparityMap.hci`, have that of `cameras`, also for a
        lens array: negate them for a scale with `sense="lenses"`, or depths behind the lenses become negative.
        """
        scaled = (np.asarray(disparity, np.float64) - self.offset) / self.factor
        with np.errstate(divide="ignore"):
            return 1 / scaled if self.is_inverse else scaled
