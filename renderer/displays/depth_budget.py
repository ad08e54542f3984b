"""How much of a scene's depth a display shows sharply, and how much of the scene leaves its frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.displays.screen import place_views
from ciir.renderer.placement import FACTORS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.displays.integral import IntegralDisplay
    from ciir.renderer.displays.lenticular import Calibration
    from ciir.renderer.displays.screen import Screen
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.scene import Scene

GHOST = 5.0
"""Pixels by which neighbouring views of a quilt may differ: above that, edges show double."""
ROUNDING = 1e-9
"""Share of a frame by which a point that just fits may seem to lie outside, and depth that counts as none."""


@dataclass(frozen=True)
class Frame:
    """The rectangle of a display in the plane z = 0, around the origin, and the directions from which it is seen.

    A viewer at `distance` D, at the side by `reach` D, sees the point (x, z) at `(x - reach z) / (1 - z / D)` in the
    plane. Other directions are seen from between there and the opposite side.
    """

    size: tuple[float, float]
    """Width and height."""
    reach: tuple[float, float]
    """Tangents of the outermost directions at the middle of the display, along x and y."""
    distance: float = math.inf
    """Distance from the plane to the viewer, or to the cameras."""

    def find_leaving(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns which of `points`, `(..., 3)`, are outside in at least one direction, or behind the viewer:
        `(...)`.
        """
        limit = np.array(self.size) / 2 * (1 + ROUNDING - points[..., 2:] / self.distance)
        leaving: NDArray[np.bool_] = np.any(self._sweep(points) > limit, axis=-1)
        return leaving

    def find_fit(self, points: NDArray[np.float64]) -> float:
        """Returns the largest factor by which `points`, `(n, 3)`, can be multiplied without leaving the frame in any
        direction; inf if there is none.
        """
        half = np.array(self.size) / 2
        needed = float(((self._sweep(points) + half * points[:, 2:] / self.distance) / half).max(initial=0))
        return 1 / needed if needed > 0 else math.inf

    def _sweep(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        swept: NDArray[np.float64] = np.abs(points[..., :2]) + np.abs(points[..., 2:]) * self.reach
        return swept


@dataclass(frozen=True)
class DepthBudget:
    """A scene's depth compared with a display's. Depths are in `unit`, positive in front of the display's plane."""

    sharp: float
    """How far in front of and behind its plane the display shows detail as fine as in the plane."""
    nearest: float
    """Depth of the scene's nearest point."""
    farthest: float
    blurred: float
    """Share of the scene's surface that lies beyond `sharp`."""
    cut: float
    """Share of the scene's surface that leaves the frame in at least one direction that the display shows."""
    unit: str

    def notes(self, zoom: float = 1.0, depth_factor: float = 1.0, *, is_fitted: bool = True) -> tuple[str, ...]:
        """Returns the budget in sentences, for the report. `zoom`, `depth_factor`: those that the scene was framed
        with. `is_fitted`: whether it was fitted to the display.
        """
        unit = self.unit
        extent = f"spans {_place(self.farthest, unit)} to {_place(self.nearest, unit)}"
        if self.nearest - self.farthest < ROUNDING:
            extent = f"lies {_place(self.nearest, unit) if abs(self.nearest) > ROUNDING else 'in it'}"
        is_lost = self.cut > 0.5 and not is_fitted
        lines = [
            (
                f"depth: the display is sharp up to {self.sharp:.3g} {unit} behind and in front of its plane; "
                f"the scene {extent}"
            )
        ]
        if self.blurred:
            found = {"depth_factor": self._find_sharp(depth_factor), "zoom": self._find_sharp(zoom)}
            accepted = [f"{name} {factor:g}" for name, factor in found.items() if factor >= FACTORS[0]]
            remedy = f"with {', or '.join(accepted)}, all of it would be sharp"
            if not accepted:
                remedy = f"some would still blur with depth_factor or zoom {FACTORS[0]:g}; give both, or a flatter mesh"
            if accepted or not is_lost:
                lines.append(f"depth: {_percent(self.blurred)} of the surface is beyond that and blurs; {remedy}")
        if self.cut:
            remedy = f"; with fit none, the mesh's coordinates count as {unit}; leave fit out" if is_lost else ""
            lines.append(f"depth: {_percent(self.cut)} of the surface leaves the frame in some directions{remedy}")
        return tuple(lines)

    def _find_sharp(self, factor: float) -> float:
        """Returns the largest zoom or depth factor of two digits with which nothing blurs, if the scene was framed with
        `factor`: depths are proportional to both.
        """
        most = factor * self.sharp / max(self.nearest, -self.farthest)
        digit = 10.0 ** (math.floor(math.log10(most)) - 1)
        return digit * math.floor(most / digit + 1e-9)


def measure_integral(scene: Scene, display: IntegralDisplay) -> DepthBudget:
    """Returns the budget of a scene in the coordinates of an integral display, millimetres."""
    return _measure(scene, display.sharp, frame_integral(display), "mm")


def frame_integral(display: IntegralDisplay) -> Frame:
    """Returns the frame of an integral display, in millimetres. A lens at its middle shows `tangent_range` to a viewer
    far away, and a little more to one who is near, for whom more pixels belong to it.
    """
    reach = display.tangent_range * (1 + display.gap / display.distance)
    return Frame(display.size, (reach, reach), display.distance)


def describe_light_field(
    cameras: Pixels, display: IntegralDisplay, disparity: float, pixel_aspect: float = 1.0
) -> tuple[str, ...]:
    """Returns a note on the disparities of a light field, `(V, U, h, w, c)`, that an integral display shows sharply.

    `disparity`: the disparity of what lies in the display's plane. See `resample_panel`, which spreads the views over
    its directions.
    """
    size_v, size_u, height, width, _ = cameras.shape
    _, scale = display.fit_views((height, width), pixel_aspect)
    moved = display.sharp * 2 * display.tangent_range / max(size_v, size_u) / scale
    flat = ("one row of views has no vertical parallax: all heights see the same",) if size_v == 1 else ()
    return (_describe_sharp(cameras, moved, disparity), *flat)


def describe_directions(share: float, counts: tuple[int, int], display: IntegralDisplay) -> tuple[str, ...]:
    """Returns a note on the share of a panel's subpixels that look in directions beyond those of all views.

    A lens sends its subpixels' light to different places in the viewing zone, so this is the mean share of lenses that
    an eye there sees. `counts`: rows and columns of views.
    """
    if share < 0.01:
        return ()
    seen, better = "", ["the mesh itself"]
    if math.isfinite(display.distance):
        inside = 1.0  # of the lenses, seen from the middle
        for count, side in zip(counts, reversed(display.size), strict=True):
            if count > 1:
                inside *= min(1.0, 2 * display.tangent_range * count / max(counts) * display.distance / side)
        seen = f", {_percent(1 - inside)} seen from the middle"
        better.append("a viewer farther away")
    if min(counts) > 1 and counts[0] != counts[1]:
        better.append("as many rows of views as columns")
    what = f"{_percent(share)} of the lenses (mean over the viewing zone{seen}) show the outermost view"
    return (f"panel: {what}, because no view covers the direction to the eye; better: {', '.join(better)}",)


def describe_native(
    cameras: Pixels, calibration: Calibration, disparity: float, pixel_aspect: float = 1.0
) -> tuple[str, ...]:
    """Returns the note of `describe_light_field` for a native picture: the depth of `measure_lenticular`, which moves
    by a lens from one of its `directions` to the next, in pixels of a view from one of the `U` views to the next.
    """
    _, size_u, height, width, _ = cameras.shape
    if size_u == 1:
        return ()
    shown = max(width, height * calibration.aspect / pixel_aspect)  # with the borders of `find_padded_size`
    moved = shown / calibration.pitch * calibration.directions / (size_u - 1)
    return (_describe_sharp(cameras, moved, disparity),)


def _describe_sharp(cameras: Pixels, moved: float, disparity: float) -> str:
    """Returns the note on a display that is sharp up to `moved` pixels per view from `disparity`."""
    note = (
        f"depth: the display is sharp for disparities from {disparity - moved:.2g} to {disparity + moved:.2g} pixels "
        "between neighbouring views"
    )
    if cameras.shape[1] == 1:
        return note
    found = _find_usual_range(cameras)
    if found is None:
        return f"{note}; the views have too little texture to measure theirs"
    least, largest = found
    is_beyond = least < disparity - moved or largest > disparity + moved
    blurs = f"; the rest blurs{_suggest_plane(least, largest, disparity, moved)}" if is_beyond else ""
    return f"{note}; those of the views are about {_round(least)} to {_round(largest)}{blurs}"


def describe_row(cameras: Pixels, count: int, disparity: float, factor: int = 1) -> tuple[str, ...]:
    """Returns a note if content moves by over `GHOST` pixels between neighbours of `count` views made from one row, and
    none if the views have too little texture to tell.

    `cameras`: `(V, U, h, w, c)`; `disparity`: the disparity of what lies in the display's plane, in pixels of the views
    before they were made `factor` times smaller.
    """
    size_u = cameras.shape[1]
    if size_u == 1 or count == 1:
        return ()
    found = _find_usual_range(cameras)
    if found is None:
        return ()
    least, largest = (factor * limit for limit in found)
    step = (size_u - 1) / (count - 1) / factor
    moved = max(abs(least - disparity), abs(largest - disparity)) * step
    if moved <= GHOST:
        return ()
    far = f"content moves by about {moved:.2g} pixels between neighbouring views of the display"
    return (f"depth: {far}; over {GHOST:g} edges show double{_suggest_plane(least, largest, disparity, GHOST / step)}",)


def _find_usual_range(cameras: Pixels) -> tuple[float, float] | None:
    from ciir.renderer.focus.stereo.search_range import find_usual_range  # loads scipy, which few commands need

    return find_usual_range(cameras)


def _suggest_plane(least: float, largest: float, disparity: float, sharp: float) -> str:
    """Returns the end of a note that suggests the best disparity for the display's plane, or nothing if it is there
    already, up to a small share of the `sharp` disparities on either side of it.
    """
    middle = (least + largest) / 2
    if abs(middle - disparity) <= max(0.05, 0.05 * sharp):
        return ""
    return f"; disparity {_round(middle)} brings its middle into the display's plane"


def _round(number: float) -> str:
    """Rounds to a tenth, without a minus before 0."""
    return f"{round(number, 1) + 0:g}"


def measure_quilt(scene: Scene, screen: Screen, views: int, pixels: int) -> DepthBudget:
    """Returns the budget of a scene in a quilt of `views` views that are `pixels` wide, in screen heights.

    Content is sharp if it moves by at most `GHOST` pixels between neighbouring views.
    """
    cameras = screen.camera_x(place_views(views))
    step = float(np.diff(cameras).max()) / screen.distance if views > 1 else 1e-9
    pixel = screen.aspect / pixels
    return _measure(scene, GHOST * pixel / step, frame_screen(screen, views), "screen heights")


def measure_lenticular(scene: Scene, screen: Screen, calibration: Calibration) -> DepthBudget:
    """Returns the budget of a scene in a native picture, in screen heights.

    Each lens shows as many directions as there are subpixels under it, or pixels if the display has no stripes.
    """
    return _measure(scene, calibration.sharp, frame_screen(screen), "screen heights")


def frame_screen(screen: Screen, views: int = 2) -> Frame:
    """Returns the frame of a screen seen by `views` cameras, in screen heights: the outermost ones decide."""
    across = float(screen.camera_x(place_views(views)).max()) / screen.distance
    return Frame((screen.aspect, 1.0), (across, 0.0), screen.distance)


def find_shrinking(scene: Scene, frame: Frame, zoom: float = 1.0) -> float:
    """Returns the factor, at most 1, that keeps a scene in the frame in all directions if its zoom is 1.

    `frame_scene` fits a scene into parallel views. A viewer at a distance sees what is in front of the display larger.
    `zoom`: the zoom that the scene was framed with.
    """
    return min([1.0, *(zoom * frame.find_fit(part.used_vertices()) for part in scene.parts)])


def _measure(scene: Scene, sharp: float, frame: Frame, unit: str) -> DepthBudget:
    total = blurred = cut = 0.0
    for part in scene.parts:
        corners = part.vertices[part.faces]  # (m, 3, 3)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        middle = corners.mean(axis=1)
        total += area.sum()
        blurred += area[np.abs(middle[:, 2]) > sharp].sum()
        leaving = frame.find_leaving(part.vertices)[part.faces].sum(axis=1) + frame.find_leaving(middle)
        cut += (area * leaving).sum() / 4  # three corners and the middle of each triangle
    low, high = scene.bounds()
    return DepthBudget(sharp, float(high[2]), float(low[2]), float(blurred / total), float(cut / total), unit)


def _place(depth: float, unit: str) -> str:
    return f"{abs(depth):.3g} {unit} {'in front of' if depth > 0 else 'behind'} it"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"
