"""What a display shows sharply of a scene's depth, and what of the scene leaves its frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.displays.screen import place_views

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.displays.integral import IntegralDisplay
    from ciir.renderer.displays.screen import Screen
    from ciir.renderer.scene import Scene

GHOST = 5.0
"""Pixels by which neighbouring views of a quilt may differ: above it edges show double."""


@dataclass(frozen=True)
class DepthBudget:
    """A scene's depth against a display's. Depths are in `unit`, positive before the display's plane."""

    sharp: float
    """How far before and behind its plane the display shows detail as fine as in it."""
    nearest: float
    """Depth of the scene's nearest point."""
    farthest: float
    blurred: float
    """Share of the scene's surface that lies beyond `sharp`."""
    cut: float
    """Share of the scene's surface that leaves the frame in at least one direction that the display shows."""
    unit: str

    def notes(self) -> tuple[str, ...]:
        """The budget in sentences, for the report."""
        unit = self.unit
        extent = f"{_place(self.farthest, unit)} to {_place(self.nearest, unit)}"
        lines = [
            f"depth: the display is sharp up to {self.sharp:.3g} {unit} behind and before it; the scene spans {extent}"
        ]
        if self.blurred:
            lines.append(
                f"depth: {_percent(self.blurred)} of the surface is beyond that and blurs; --zoom {self._fit():.2g} "
                "would keep all of it sharp"
            )
        if self.cut:
            lines.append(f"depth: {_percent(self.cut)} of the surface leaves the frame in some directions")
        return tuple(lines)

    def _fit(self) -> float:
        """The factor on the scene's size at which nothing blurs."""
        return self.sharp / max(self.nearest, -self.farthest)


def measure_integral(scene: Scene, display: IntegralDisplay) -> DepthBudget:
    """The budget of a scene that stands in the coordinates of an integral display, millimetres.

    The lines of neighbouring pixels under a lens part by `tangent_step` for each millimetre of depth. Up to the depth
    `lens_pitch / tangent_step` they are closer than the lenses, which then limit the detail; beyond it the lines do
    (the bandwidth of a light-field display, Zwicker et al., EGSR 2006).
    """
    sharp = display.lens_pitch / display.tangent_step
    reach = (display.tangent_range, display.tangent_range)
    return _measure(scene, sharp, display.size, reach, "mm")


def measure_screen(scene: Scene, screen: Screen, views: int, pixels: int) -> DepthBudget:
    """The budget of a scene before a lenticular display of `views` views that are `pixels` wide, in screen heights.

    Sharp is what moves by at most `GHOST` pixels between neighbouring views.
    """
    cameras = screen.camera_x(place_views(views))
    step = float(np.diff(cameras).max()) / screen.distance if views > 1 else 1e-9
    pixel = screen.aspect / pixels
    reach = (float(np.abs(cameras).max()) / screen.distance, 0.5 / screen.distance)
    return _measure(scene, GHOST * pixel / step, (screen.aspect, 1.0), reach, "screen heights")


def _measure(
    scene: Scene, sharp: float, size: tuple[float, float], reach: tuple[float, float], unit: str
) -> DepthBudget:
    total = blurred = cut = 0.0
    for part in scene.parts:
        corners = part.vertices[part.faces]  # (m, 3, 3)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        middle = corners.mean(axis=1)
        total += area.sum()
        blurred += area[np.abs(middle[:, 2]) > sharp].sum()
        cut += area[_leaves(middle, size, reach)].sum()
    low, high = scene.bounds()
    return DepthBudget(sharp, float(high[2]), float(low[2]), float(blurred / total), float(cut / total), unit)


def _leaves(points: NDArray[np.float64], size: tuple[float, float], reach: tuple[float, float]) -> NDArray[np.bool_]:
    """Whether some line through each of `points`, with tangents up to `reach`, meets the plane outside the frame."""
    swept = np.abs(points[:, :2]) + np.abs(points[:, 2:]) * reach
    leaves: NDArray[np.bool_] = np.any(swept > np.array(size) / 2, axis=1)
    return leaves


def _place(depth: float, unit: str) -> str:
    return f"{abs(depth):.3g} {unit} {'before' if depth > 0 else 'behind'} it"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"
