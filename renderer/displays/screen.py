"""A lenticular display as seen by cameras side by side, each looking straight ahead at the same rectangle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.backends.progress import ignore_progress, run_parts
from ciir.renderer.lens_array import LensArray
from ciir.renderer.sampling import check_samples

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.displays.lenticular import Calibration
    from ciir.renderer.displays.rays import RayCaster

FIELD_OF_VIEW = 14.0
"""Degrees from the screen's lower to its upper edge as a camera sees it, as Looking Glass' own software assumes."""
MAX_CONE = 120.0
BAND = 1 << 16
"""Most rays in the rows of a view that are cast together."""


@dataclass(frozen=True)
class Screen:
    """A rectangle in the plane z = 0, around the origin, of height 1 and width `aspect`, seen from z > 0.

    Cameras stand on the line `(d tan(angle), 0, d)`, `angle` from `-cone/2` (leftmost) to `cone/2`, at the distance d
    from which the screen's height fills `field_of_view`. They are shifted, not toed in: each camera's frustum is
    sheared so that its picture is this rectangle. Content in the plane z = 0 is at the same place in all views.

    Raises `InvalidOption` if `cone` is out of range.
    """

    aspect: float
    cone: float = 40.0
    """Degrees between the outermost cameras."""
    field_of_view: float = FIELD_OF_VIEW
    """Degrees from the lower to the upper edge, from which the cameras' distance follows."""

    def __post_init__(self) -> None:
        if not 0 < self.cone <= MAX_CONE:
            raise InvalidOption(f"cone: {self.cone:g} degrees is out of range; give more than 0, at most {MAX_CONE:g}")

    @property
    def distance(self) -> float:
        """Distance from the screen to the cameras, in heights of the screen."""
        return float(0.5 / np.tan(np.radians(self.field_of_view / 2)))

    def lens_array(self) -> LensArray:
        """Returns a lens array of the screen's size whose views cover its cameras' directions, for `frame_scene`."""
        across, up = np.tan(np.radians(self.cone) / 2), np.tan(np.radians(FIELD_OF_VIEW) / 2)
        step = float(across) / 100
        pixels_v = 2 * int(np.ceil(up / step)) + 1
        return LensArray(1000, round(1000 * self.aspect), pixels_v, 201, pitch=1e-3, delta=step)

    def camera_x(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns x of the cameras at `place`, of any shape, 0 for the leftmost and 1 for the rightmost."""
        x: NDArray[np.float64] = self.distance * np.tan(np.radians(self.cone) * (place - 0.5))
        return x

    def cast(
        self, caster: RayCaster, x: NDArray[np.float64], y: NDArray[np.float64], place: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """Returns the colours `(n, 3)`, 0 to 255, of points of the screen as cameras at `place` see them.

        `x`, `y`: `(n,)`, 0 at the left and at the bottom, 1 at the right and at the top; `place`: `(n,)`, as in
        `camera_x`.
        """
        points = np.stack([(x - 0.5) * self.aspect, y - 0.5, np.zeros_like(x)], axis=1)
        cameras = np.stack([self.camera_x(place), np.zeros_like(x), np.full_like(x, self.distance)], axis=1)
        return caster.cast(cameras, points - cameras)

    def render_views(
        self,
        caster: RayCaster,
        count: int,
        size: tuple[int, int],
        *,
        samples: int = 1,
        progress: Progress = ignore_progress,
    ) -> NDArray[np.uint8]:
        """Returns `count` views, `(count, height, width, 3)`, from the leftmost camera on, with cameras at equal steps
        of the angle.

        `size`: height and width in pixels, which may be square or not. `samples`: rays along each side of a pixel,
        whose colour is their mean. Raises `InvalidOption` if `samples` is out of range.
        """
        check_samples(samples)
        height, width = size
        places = place_views(count)
        views = np.empty((count, height, width, 3), np.uint8)
        rows = max(1, BAND // (width * samples**2))
        bands = -(-height // rows)
        x = (np.arange(width * samples) + 0.5) / (width * samples)

        def make(index: int) -> None:
            view, band = divmod(index, bands)
            lines = np.arange(band * rows * samples, min((band + 1) * rows, height) * samples)
            y = np.repeat(1 - (lines + 0.5) / (height * samples), len(x))
            colors = self.cast(caster, np.tile(x, len(lines)), y, np.full(len(y), places[view]))
            cells = colors.reshape(-1, samples, width, samples, 3)
            total = sum(cells[:, i, :, j] for i in range(samples) for j in range(samples))
            views[view, band * rows : (band + 1) * rows] = np.rint(total / np.float32(samples**2))

        run_parts(make, count * bands, lambda done, _: progress(done // bands, count))
        return views

    def render_native(
        self, caster: RayCaster, calibration: Calibration, *, progress: Progress = ignore_progress
    ) -> NDArray[np.uint8]:
        """Returns the native picture `(height, width, 3)` for `calibration`, each subpixel cast from its own camera."""
        native = np.empty((calibration.height, calibration.width, 3), np.uint8)

        def make(row: int) -> None:
            x, y = calibration.content_positions(row)  # (width,)
            places = calibration.view_places(row)  # (width, 3)
            colors = self.cast(caster, np.repeat(x, 3), np.repeat(y, 3), places.ravel()).reshape(-1, 3, 3)
            native[row] = np.rint(np.diagonal(colors, axis1=1, axis2=2))  # each ray gives the colour of its subpixel

        run_parts(make, calibration.height, progress)
        return native


def place_views(count: int) -> NDArray[np.float64]:
    """Returns the places of `count` cameras, 0 to 1, for `Screen.camera_x`; a single camera stands in the middle."""
    return np.linspace(0, 1, count) if count > 1 else np.array([0.5])
